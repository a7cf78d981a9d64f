// SPDX-License-Identifier: MIT
// The method's steps and numbers, each alone.
#include "recon/method/method.hpp"

#include <nlohmann/json.hpp>

#include "drivers/program/console.hpp"
#include "drivers/program/settings.hpp"
#include "recon/method/bin_sums.hpp"
#include "recon/numbers/blas_kernels.hpp"
#include "recon/train/train.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using echofuse::testing::Folder;

namespace {

// Each key with a value that is neither its default nor a limit.
const std::map<std::string, std::string> changed = {{"background_quantile", "0.125"},
                                                    {"steadiness", "3.5"},
                                                    {"centroid_passes", "5"},
                                                    {"body_m", "0.75"},
                                                    {"significance", "6.5"},
                                                    {"histogram_m", "0.9"},
                                                    {"histogram_step_m", "0.05"},
                                                    {"profile_from_m", "-0.625"},
                                                    {"profile_to_m", "1.25"},
                                                    {"least_profile_step_m", "0.03125"},
                                                    {"coarse_step_m", "0.0625"},
                                                    {"steps_a_resolution", "1.5"},
                                                    {"shift_from_m", "-0.375"},
                                                    {"shift_to_m", "0.5"},
                                                    {"part_from_m", "-0.25"},
                                                    {"part_to_m", "0.5"},
                                                    {"least_part_m", "0.25"},
                                                    {"lags_of_parts", "3"},
                                                    {"directions", "64"},
                                                    {"refinements", "2"},
                                                    {"nearest_m", "0.25"},
                                                    {"least_deviation", "0.0625"},
                                                    {"threshold_from", "0.375"},
                                                    {"threshold_to", "0.75"},
                                                    {"many_records", "5000"},
                                                    {"units", "24"},
                                                    {"units_of_many", "64"},
                                                    {"place_networks", "2"},
                                                    {"shape_networks", "1"},
                                                    {"depth_weight", "0.5"},
                                                    {"component_bodies", "500"},
                                                    {"turned_records", "600"}};

void set_all(MethodConfig& config) {
  Settings settings;
  bind(settings, config);
  for (const auto& [key, value] : changed) settings.set(key + "=" + value);
}

// As facts of a file: all keys of a configuration are numbers.
std::map<std::string, TensorFile::Fact> facts_of(MethodConfig config) {
  TensorFile file;
  archive({file, Archive::Direction::write}, config);
  return file.facts;
}

}  // namespace

TEST_CASE("sums over bins in four sums side by side are those of one plain loop") {
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
        const BinSums plain = plain_bin_sums(counts, all, from, to, negative);
        // The tolerance follows the terms of the sum, as terms of both signs may cancel.
        double sizes = 1e-300, moments = 1e-300;
        for (std::size_t i = from; i < to; ++i)
          sizes += std::abs(double{counts[i]}),
              moments += std::abs(double{counts[i]}) * static_cast<double>(i);
        REQUIRE(std::abs(fast.counts - plain.counts) <= 1e-12 * sizes);
        REQUIRE(std::abs(fast.moment - plain.moment) <= 1e-12 * moments);
        REQUIRE(fast.all == Approx(plain.all).epsilon(1e-12));
      }
  }
}

TEST_CASE("negative bins count as nothing where they are left out") {
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

TEST_CASE("a file keeps every number of the method that may be set") {
  MethodConfig config;
  set_all(config);
  const auto before = facts_of({}), after = facts_of(config);
  REQUIRE(after.size() == changed.size());
  for (const auto& [key, value] : changed) {
    CAPTURE(key);
    REQUIRE(after.count(key) == 1);
    CHECK(before.at(key) != after.at(key));
  }
  TensorFile file;
  archive({file, Archive::Direction::write}, config);
  TensorFile again("a model", file.to_bytes());
  MethodConfig read;
  archive({again, Archive::Direction::read}, read);
  CHECK(facts_of(read) == after);
  // One that is missing, and one out of its range.
  for (const TensorFile::Fact& fact : {TensorFile::Fact(-7.0), TensorFile::Fact("wide")}) {
    TensorFile spoilt = file;
    spoilt.facts["histogram_m"] = fact;
    CHECK_THROWS_WITH(archive({spoilt, Archive::Direction::read}, read),
                      Catch::Contains("histogram_m"));
  }
  file.facts.erase("directions");
  CHECK_THROWS_WITH(archive({file, Archive::Direction::read}, read), Catch::Contains("directions"));
}

TEST_CASE(
    "each tensor of a file stands at a multiple of its type's size, and the file says what wrote "
    "it") {
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

TEST_CASE("another window of the histogram makes views of another size, and a model keeps it") {
  const Folder dir;
  const Dataset data = testing::load_plates(150);
  TrainOptions options;
  options.model = "mean-shape", options.uncertainty = false;
  options.fit.epochs = 2, options.fit.quiet = true;
  const TrainedModel usual = train(data, options);
  options.config.histogram_m = 0.9;
  const TrainedModel wide = train(data, options);
  CHECK(usual->alignment.histogram_bins() == 35);
  CHECK(wide->alignment.histogram_bins() == 45);
  CHECK(wide->alignment.inputs() == usual->alignment.inputs() + 10);
  save_model(wide, dir / "m");
  const TrainedModel loaded = load_model(dir / "m");
  CHECK(loaded->alignment.config().histogram_m == 0.9);
  const Rows rows = {0, 1, 149};
  const Matrix views = loaded->views(data, rows, true);
  CHECK(views.cols == wide->alignment.inputs());
  CHECK(views.values == wide->views(data, rows, true).values);
  CHECK(loaded.predict(data, rows).values == wide.predict(data, rows).values);
}
