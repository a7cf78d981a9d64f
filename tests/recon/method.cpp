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
  std::normal_distribution<float> background(40, 3);
  for (std::size_t bins = 3; bins <= 600; ++bins) {
    std::vector<float> counts, all;
    for (std::size_t i = 0; i < bins; ++i) {
      all.push_back(static_cast<float>(photons(rng)));
      counts.push_back(all.back() - background(rng));
    }
    std::uniform_int_distribution<std::size_t> any(0, bins);
    const std::size_t a = any(rng), b = any(rng);
    for (const auto& [from, to] :
         {std::pair{std::size_t{0}, bins}, {std::min(a, b), std::max(a, b)}})
      for (const Negative negative : {Negative::left_out, Negative::counted}) {
        CAPTURE(bins, from, to, negative);
        const BinSums fast = bin_sums(counts, all, from, to, negative);
        BinSums plain;
        // The tolerance is proportional to the sum of the magnitudes, because positive and negative
        // terms may cancel.
        double sizes = 1e-300, moments = 1e-300;
        for (std::size_t i = from; i < to; ++i) {
          const double count = double{counts[i]}, bin = static_cast<double>(i);
          const double weight = negative == Negative::counted ? count : std::max(count, 0.0);
          plain.counts += weight, plain.moment += weight * bin, plain.all += double{all[i]};
          sizes += std::abs(count), moments += std::abs(count) * bin;
        }
        REQUIRE(std::abs(fast.counts - plain.counts) <= 1e-12 * sizes);
        REQUIRE(std::abs(fast.moment - plain.moment) <= 1e-12 * moments);
        REQUIRE(fast.all == Approx(plain.all).epsilon(1e-12));
      }
  }
}

TEST_CASE("histogram sums count negative bins as zero if negative values are excluded") {
  const std::vector<float> counts = {2, -3, 4, -5, 6, -1, 1}, all = {9, 9, 9, 9, 9, 9, 9};
  const BinSums without = bin_sums(counts, all, 0, 7, Negative::left_out);
  CHECK(without.counts == 13);
  CHECK(without.moment == 8 + 24 + 6);
  CHECK(without.all == 63);
  const BinSums with = bin_sums(counts, all, 1, 6, Negative::counted);
  CHECK(with.counts == 1);
  CHECK(with.moment == -3 + 8 - 15 + 24 - 5);
  CHECK(with.all == 45);
}

TEST_CASE(
    "a model file stores the method's constants and is refused if those of the program differ") {
  const Layout layout{spd_axis(), radar_axis()};
  Alignment alignment(layout, Matrix(1, layout.inputs()), {0});
  TensorFile file;
  alignment.archive({file, Archive::Direction::write}, layout);
  CHECK(std::get<double>(file.facts.at("config/histogram_m")) == method::histogram_m);
  CHECK(std::get<std::int64_t>(file.facts.at("config/directions")) == method::directions);
  const auto fault_of = [&](const TensorFile& written) {
    TensorFile read("a model", written.to_bytes());
    return error_of([&] { alignment.archive({read, Archive::Direction::read}, layout); });
  };
  CHECK(fault_of(file) == "no error");
  for (const auto& [key, value] : {std::pair<const char*, TensorFile::Fact>{"histogram_m", 0.9},
                                   {"histogram_m", "wide"},
                                   {"directions", std::int64_t{64}}}) {
    TensorFile spoilt = file;
    spoilt.facts["config/" + std::string(key)] = value;
    CHECK_THAT(fault_of(spoilt), Catch::Contains(key));
  }
  file.facts.erase("config/directions");
  CHECK_THAT(fault_of(file), Catch::Contains("directions"));
}

TEST_CASE("model files align tensors to the size of their type and contain the program version") {
  TensorFile file;
  const auto write = [&](const std::string& name, auto value) {
    const std::vector<decltype(value)> three(3, value);
    file.write<decltype(value)>(name, three, {3});
  };
  write("a", std::uint8_t{7});
  write("b", 1.5F);
  write("c", 2.5);
  write("d", std::uint32_t{8});
  write("e", std::int64_t{9});
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
