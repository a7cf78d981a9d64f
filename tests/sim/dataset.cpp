// SPDX-License-Identifier: MIT
#include "sim/dataset/dataset.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>

#include "acquire/record/depth_map.hpp"
#include "acquire/record/run_file.hpp"

using namespace echofuse;
using namespace echofuse::sim;

namespace {

Plan small_plan() {
  Plan plan;
  plan.seed = 11;
  plan.people = 40;
  plan.letters = 90;
  plan.two_people = 7;
  plan.empty = 3;
  return plan;
}

// A fresh folder that goes with the test.
struct Folder {
  std::filesystem::path path;
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "echofuse-XXXXXX").string();
    REQUIRE(mkdtemp(name.data()));
    path = name;
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::string file(const std::string& name) const { return (path / name).string(); }
};

void check_equal(const record::FusedRecord& a, const record::FusedRecord& b) {
  REQUIRE(a.index == b.index);
  CHECK(a.label == b.label);
  CHECK(a.valid == b.valid);
  CHECK(a.slot_start == b.slot_start);
  CHECK(a.spd == b.spd);
  CHECK(a.radar == b.radar);
  CHECK(a.depth_mm == b.depth_mm);
  CHECK(a.spd_counts.in_range == b.spd_counts.in_range);
}

std::vector<record::FusedRecord> read_all(const std::string& path) {
  std::vector<record::FusedRecord> records;
  record::RunReader(path).for_each([&](const record::FusedRecord& r) {
    records.push_back(r);
    return true;
  });
  return records;
}

}  // namespace

TEST_CASE("a data set reads back as the records its plan makes, in any order, on any threads") {
  const Folder folder;
  const Plan plan = small_plan();
  const Generator generator(plan);
  for (const int threads : {1, 3}) {
    const std::string path = folder.file(std::to_string(threads) + ".sqlite");
    CHECK(write_dataset(plan, {path, "# mine\n", threads, true}) ==
          static_cast<std::int64_t>(scenes_of(plan).size()));
    const auto records = read_all(path);
    REQUIRE(records.size() ==
            static_cast<std::size_t>(static_cast<std::int64_t>(scenes_of(plan).size())));
    for (std::int64_t i = static_cast<std::int64_t>(scenes_of(plan).size()) - 1; i >= 0; --i)
      check_equal(records[static_cast<std::size_t>(i)], generator.make(i));
  }
}

TEST_CASE("a data set with antennas reads back as made, on any threads") {
  const Folder folder;
  Plan plan = small_plan();
  plan.people = 9, plan.letters = 3;
  const auto plain = Generator(plan).make(4);
  plan.conditions.radar_antennas = 8;
  plan.conditions.radar_phase_error_rad = 0.3;
  const Generator generator(plan);
  check_equal(generator.make(4), plain);  // incoherent: nothing else is another
  for (const int threads : {1, 3}) {
    const std::string path = folder.file(std::to_string(threads) + ".sqlite");
    write_dataset(plan, {path, "", threads, true});
    const record::RunReader run(path);
    CHECK(run.antennas() == generator.stated_antennas());
    CHECK(run.axis("array")->count == 29);
    for (const auto& r : read_all(path)) {
      CHECK(r.array_frames == 60);
      std::vector<float> stored;
      const auto packed = record::pack_array(generator.make(r.index).array, 8);
      CHECK(record::unpack_array(packed, 29, 8, stored).empty());
      CHECK(r.array == stored);
    }
  }
  plan.conditions.radar_sum = "coherent";
  const auto speckle = Generator(plan).make(4);
  for (std::size_t i = 0; i < speckle.radar.size(); ++i)
    CHECK(record::bin_of(speckle.array, 8, i).power() / 8 ==
          Approx(speckle.radar[i]).epsilon(1e-4));
  CHECK(speckle.depth_mm == plain.depth_mm);
}

TEST_CASE("a data set describes itself") {
  const Folder folder;
  Plan plan = small_plan();
  plan.conditions.irf_fwhm_ps = 50;
  plan.conditions.background = "room";
  plan.conditions.half_tangent = 0.4;
  const std::string path = folder.file("run.sqlite");
  write_dataset(plan, {path, "# mine\n", 2, true});
  const record::RunReader run(path);
  CHECK(run.info().status == "complete");
  CHECK(run.info().config_text == "# mine\n");
  CHECK_FALSE(run.info().version.empty());
  CHECK(run.check().empty());
  CHECK(same_axis(*run.axis("spd"), spd_axis(plan.conditions)));
  CHECK(same_axis(*run.axis("radar"), radar_axis(plan.conditions)));
  CHECK(run.axis("depth_x")->at(63.5) == Approx(0.4));
  CHECK(run.axis("depth_y")->at(63.5) == Approx(-0.4));
  CHECK(record::map_grid_of(run.axes()) == record::MapGrid{64, 0.4});
  const Plan stored = plan_of(path);
  CHECK(stored.seed == plan.seed);
  CHECK(stored.letters == plan.letters);
  CHECK(stored.conditions.irf_fwhm_ps == 50);
  CHECK(stored.conditions.background == "room");
  std::int64_t people = 0, letters = 0, two = 0, empty = 0;
  for (const auto& r : read_all(path)) {
    people += r.label == "person";
    letters += r.label.rfind("letter:", 0) == 0;
    two += r.label == "two_people";
    empty += r.label == "empty";
    CHECK(r.valid == SensorSet::from_bits(7));
    std::uint64_t clicks = 0;
    for (const auto n : r.spd) clicks += n;
    CHECK(r.spd_counts.in_range == clicks);
  }
  CHECK(people == plan.people);
  CHECK(letters == plan.letters);
  CHECK(two == plan.two_people);
  CHECK(empty == plan.empty);
}

TEST_CASE("a data set's maps have the size and field that are asked for") {
  Plan plan;
  plan.people = 1, plan.letters = 0;
  const auto plain = Generator(plan).make(0);
  plan.conditions.map_size = 128, plan.conditions.map_half_tangent = 0.275;
  const auto other = Generator(plan).make(0);
  CHECK(plain.spd == other.spd);
  REQUIRE(other.depth_mm.size() == 128 * 128);
  CHECK(map_grid(plan.conditions) == record::MapGrid{128, 0.275});
  plan.conditions.map_half_tangent = 0.01;
  CHECK_THROWS_AS(validate(plan.conditions), Error);
}

TEST_CASE("kinds are shuffled by the seed") {
  Plan plan = small_plan();
  const auto kinds = scenes_of(plan);
  CHECK(kinds == scenes_of(plan));
  CHECK_FALSE(std::is_sorted(kinds.begin(), kinds.end(),
                             [](const auto& a, const auto& b) { return a.kind < b.kind; }));
  plan.seed = 12;
  CHECK(kinds != scenes_of(plan));
}

TEST_CASE("the mirrored set has the mirrored maps, and noise of its own") {
  Plan plan = small_plan();
  const Generator scenes(plan);
  plan.mirrored = true;
  const Generator images(plan);
  for (std::int64_t k = 0; k < 20; ++k) {
    const auto a = scenes.make(k), b = images.make(k);
    CHECK(a.label == b.label);
    for (std::size_t p = 0; p < a.depth_mm.size(); ++p)
      REQUIRE(a.depth_mm[p] == b.depth_mm[p / 64 * 64 + 63 - p % 64]);
    if (a.label != "empty") CHECK(a.spd != b.spd);
  }
}

TEST_CASE("contradictory conditions and taken names are refused") {
  const Folder folder;
  Plan plan = small_plan();
  const std::string path = folder.file("run.sqlite");
  plan.conditions.target_z_min_m = 5;
  CHECK_THROWS_AS(write_dataset(plan, {path, "", 1, true}), Error);
  CHECK_FALSE(std::filesystem::exists(path));
  plan.conditions.target_z_max_m = 5;
  plan.people = 1;
  plan.letters = plan.two_people = plan.empty = 0;
  CHECK(write_dataset(plan, {path, "", 1, true}) == 1);
  CHECK_THROWS_AS(write_dataset(plan, {path, "", 1, true}), Error);
}
