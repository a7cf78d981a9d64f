// SPDX-License-Identifier: MIT
// Tests numerical steps and constants that all models share.
#include "recon/method/method.hpp"

#include "drivers/util/console.hpp"
#include "recon/method/bin_sums.hpp"
#include "recon/numbers/blas.hpp"
#include "world.hpp"

TEST_CASE("histogram sums with four accumulators equal those of a plain loop") {
  Rng rng = make_rng(1, 0);
  std::poisson_distribution<int> photons(40);
  for (std::size_t bins = 3; bins <= 600; ++bins) {
    // Sums of whole numbers are exact in any order.
    std::vector<float> counts, all;
    for (std::size_t i = 0; i < bins; ++i) {
      all.push_back(static_cast<float>(photons(rng)));
      counts.push_back(all.back() - static_cast<float>(photons(rng)));
    }
    std::uniform_int_distribution<std::size_t> any(0, bins);
    const auto [from, to] = std::minmax({any(rng), any(rng)});
    for (const auto& [a, b] : {std::pair{std::size_t{0}, bins}, {from, to}})
      for (const Negative negative : {Negative::left_out, Negative::counted}) {
        CAPTURE(bins, a, b, negative);
        const BinSums fast = bin_sums(counts, all, a, b, negative);
        BinSums plain;
        for (std::size_t i = a; i < b; ++i) {
          const double count = double{counts[i]};
          const double weight = negative == Negative::counted ? count : std::max(count, 0.0);
          plain.counts += weight, plain.moment += weight * static_cast<double>(i);
          plain.all += double{all[i]};
        }
        REQUIRE(fast.counts == plain.counts);
        REQUIRE(fast.moment == plain.moment);
        REQUIRE(fast.all == plain.all);
      }
  }
}

TEST_CASE("model files align tensors to the size of their type and contain the program version") {
  TensorFile file;
  const auto write = [&](const std::string& name, auto value) {
    const std::vector<decltype(value)> three(3, value);
    file.write<decltype(value)>(name, three, {3});
  };
  write("a", std::uint8_t{7}), write("b", 1.5F), write("c", 2.5);
  write("d", std::uint32_t{8}), write("e", std::int64_t{9});
  const Bytes bytes = file.to_bytes();
  ByteReader in(bytes);
  const ByteView text = in.take(in.get<std::uint64_t>());
  const auto head = nlohmann::json::parse(text.begin(), text.end());
  for (const auto& [name, width] : {std::pair{"a", 1}, {"b", 4}, {"c", 8}, {"d", 4}, {"e", 8}}) {
    CAPTURE(name);
    CHECK((8 + text.size() + head[name]["data_offsets"][0].get<std::size_t>()) % width == 0);
  }
  CHECK(head["__metadata__"]["commit"] == commit());
  CHECK(head["__metadata__"]["kernel"] == blas_kernels());
  const TensorFile again("a model", bytes);
  CHECK(again.read<double>("c", {3}) == std::vector<double>(3, 2.5));
  CHECK(again.read<std::uint8_t>("a", {3}) == std::vector<std::uint8_t>(3, 7));
}
