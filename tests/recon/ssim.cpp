// SPDX-License-Identifier: MIT

#include "../catch.hpp"
#include "../fixtures/paths.hpp"
#include "recon/metrics/metrics.hpp"
#include "recon/numbers/statistics.hpp"

using namespace echofuse::recon;

namespace {

constexpr std::size_t size = 64;

struct Pair {
  std::vector<float> a, b;
};

// Computes the same pair of maps as the function maps() in tests/golden/make_ssim.py.
Pair make_pair_of_maps(unsigned pair) {
  std::uint32_t state = pair + 1;
  const auto next = [&] {
    state = 1664525u * state + 1013904223u;
    return (state >> 8) / 16777216.0;
  };
  Pair out;
  for (unsigned r = 0; r < size; ++r)
    for (unsigned c = 0; c < size; ++c) {
      const double u = next(), v = next();
      const bool row = r >= 16 && r < 48;
      const double a = pair % 2 ? 6 * u : row && c >= 20 && c < 36 ? 3 + u : 0;
      const double b = pair % 2                                 ? 6 * (0.7 * u + 0.3 * v)
                       : row && c >= 20 + pair && c < 36 + pair ? 3 + v
                                                                : 0.1 * v;
      out.a.push_back(static_cast<float>(a));
      out.b.push_back(static_cast<float>(b));
    }
  return out;
}

}  // namespace

TEST_CASE("SSIM equals the result of scikit-image for 20 image pairs") {
  std::ifstream golden(echofuse::test::source_dir + "/tests/golden/ssim.txt");
  std::string line;
  unsigned seen = 0;
  while (std::getline(golden, line)) {
    if (line.starts_with("#")) continue;
    unsigned pair = 0;
    double expected = 0;
    std::istringstream(line) >> pair >> expected;
    const Pair maps = make_pair_of_maps(pair);
    CAPTURE(pair);
    CHECK(mean_of(ssim_map(maps.a, maps.b, size, 6)) == Approx(expected).margin(1e-7).epsilon(0));
    ++seen;
  }
  CHECK(seen == 20);
}
