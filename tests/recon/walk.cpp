// SPDX-License-Identifier: MIT
// People who walk through a record of a study.
#include "recon/study/simulate.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

TEST_CASE("a walk adds up short records of the same people on their ways") {
  const Folder dir;
  const Simulator simulator(echofuse::test::bin_dir + "/echofuse-sim", dir.path, 1);
  const Dataset stands = simulator.make({.walks_m = 1e-6}, 20, 7),
                walks = simulator.make({.walks_m = 1.5}, 20, 7);
  CHECK(stands.depth.values == walks.depth.values);  // the middle of the way
  const auto width = [](const Dataset& data, std::size_t row) {
    double n = 0, mean = 0, square = 0;
    for (std::size_t i = 0; i < data.spd.cols; ++i) {
      const double count = data.spd.row(row)[i], at = static_cast<double>(i);
      n += count, mean += count * at, square += count * at * at;
    }
    return square / n - mean * mean / n / n;
  };
  double photons = 0, wider = 0;
  for (std::size_t row = 0; row < 20; ++row) {
    wider += width(walks, row) > width(stands, row);
    for (const float count : walks.spd.row(row)) photons += double{count} / 20;
  }
  CHECK(wider > 14);  // but for who crosses the line of sight
  CHECK_THAT(photons, Catch::WithinRel(1e5, 0.5));
}
