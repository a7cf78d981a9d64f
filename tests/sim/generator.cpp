// SPDX-License-Identifier: MIT
#include "sim/dataset/generator.hpp"

#include <map>

#include "../fixtures/damage.hpp"
#include "../fixtures/error.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/run.hpp"
#include "sim/sensors/radar_echo.hpp"

using namespace echofuse::sim;
using namespace echofuse::test;

namespace {

Plan small_plan() {
  Plan plan;
  plan.seed = 11;
  plan.people = 40, plan.letters = 90, plan.two_people = 7, plan.empty = 3;
  return plan;
}

void check_equal(const record::FusedRecord& a, const record::FusedRecord& b) {
  REQUIRE(a.index == b.index);
  CHECK(a.label == b.label);
  CHECK(a.valid == b.valid);
  CHECK(a.slot_start == b.slot_start);
  CHECK(difference(a, b) == "");
  CHECK(a.spd_counts.in_range == b.spd_counts.in_range);
}

}  // namespace

TEST_CASE("a simulated data set does not depend on the generation order or the number of threads") {
  const Folder folder;
  const Plan plan = small_plan();
  const Generator generator(plan);
  for (const int threads : {1, 3}) {
    const std::string path = folder / (std::to_string(threads) + ".sqlite");
    CHECK(write_dataset(plan, {path, "# mine\n", threads, true}) == generator.records());
    const auto records = records_of(path);
    REQUIRE(std::ssize(records) == generator.records());
    for (std::int64_t i = generator.records() - 1; i >= 0; --i)
      check_equal(records[static_cast<std::size_t>(i)], generator.make(i));
  }
}

TEST_CASE(
    "a simulated data set with antennas stores their statistics, and all other data as before") {
  const Folder folder;
  Plan plan = small_plan();
  plan.people = 9, plan.letters = 3;
  const auto plain = Generator(plan).make(4);
  plan.conditions.radar_antennas = 8;
  plan.conditions.radar_phase_error_rad = 0.3;
  const Generator generator(plan);
  // If the echoes are added incoherently, adding antennas does not change the other data.
  check_equal(generator.make(4), plain);
  const std::string path = folder / "run.sqlite";
  write_dataset(plan, {path, "", 3, true});
  const record::RunReader run(path);
  CHECK(run.antennas() == generator.stated_antennas());
  CHECK(run.axis("array")->count == 29);
  for (const auto& r : records_of(path)) {
    CHECK(r.array_frames == 60);
    std::vector<float> stored;
    const auto packed = record::pack_array(antenna_data(generator.make(r.index)), 8);
    CHECK(record::unpack_array(packed, 29, 8, stored).empty());
    CHECK(antenna_data(r) == stored);
  }
  plan.conditions.radar_sum = "coherent";
  const auto speckle = Generator(plan).make(4);
  // The mean noise power is subtracted from range profiles, but not from antenna samples.
  const double noise = radar_noise_power(
      plan.conditions, mean_peak_power(radar_response(plan.conditions), plan.conditions));
  for (std::size_t i = 0; i < power(speckle).size(); ++i)
    CHECK(record::bin_of(antenna_data(speckle), 8, i).power() / 8 - double{power(speckle)[i]} ==
          Approx(noise).margin(1e-4));
  CHECK(depth_mm(speckle) == depth_mm(plain));
}

TEST_CASE("a simulated data set stores its settings and has the requested number of scenes") {
  const Folder folder;
  Plan plan = small_plan();
  plan.conditions.irf_fwhm_ps = 50;
  plan.conditions.background = "room";
  plan.conditions.half_tangent = 0.4;
  const std::string path = folder / "run.sqlite";
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
  Plan stored;
  Settings settings;
  bind(settings, stored);
  settings.read_text(run.info().config_resolved, path);
  CHECK(stored.seed == plan.seed);
  CHECK(stored.letters == plan.letters);
  CHECK(stored.conditions.irf_fwhm_ps == 50);
  CHECK(stored.conditions.background == "room");
  std::map<std::string, std::int64_t> scenes;
  for (const auto& r : records_of(path)) {
    ++scenes[r.label.substr(0, r.label.find(':'))];
    CHECK(r.valid == SensorSet::from_bits(7));
    CHECK(r.spd_counts.in_range ==
          std::accumulate(counts(r).begin(), counts(r).end(), std::uint64_t{0}));
  }
  CHECK(scenes == std::map<std::string, std::int64_t>{
                      {"person", 40}, {"letter", 90}, {"two_people", 7}, {"empty", 3}});
}

TEST_CASE("a simulated data set has depth maps of the requested size and field of view") {
  Plan plan;
  plan.people = 1, plan.letters = 0;
  const auto plain = Generator(plan).make(0);
  plan.conditions.map_size = 128, plan.conditions.map_half_tangent = 0.275;
  const auto other = Generator(plan).make(0);
  CHECK(counts(plain) == counts(other));
  REQUIRE(depth_mm(other).size() == 128 * 128);
  CHECK(map_grid(plan.conditions) == record::MapGrid{128, 0.275});
}

TEST_CASE("the records of an empty room differ by noise of the set power only") {
  Plan plan;
  plan.people = plan.letters = 0, plan.empty = 40;
  plan.conditions.background_counts = 5000;
  const Generator generator(plan);
  double squares = 0, photons = 0;
  for (std::int64_t i = 0; i < 40; ++i) {
    const auto r = generator.make(i);
    for (const float p : power(r)) squares += double{p} * p / 40 / 29;
    photons += static_cast<double>(r.spd_counts.in_range) / 40;
    CHECK((i == 0 || counts(r) != counts(generator.make(i - 1))));
  }
  const double noise = radar_noise_power(
      plan.conditions, mean_peak_power(radar_response(plan.conditions), plan.conditions));
  CHECK(std::sqrt(squares) == Approx(noise).epsilon(4.5 / std::sqrt(2 * 40 * 29)));
  CHECK(photons == Approx(5000).epsilon(4.5 / std::sqrt(40 * 5000)));
}

TEST_CASE("the scene kinds in a data set are shuffled in an order that depends only on the seed") {
  Plan plan = small_plan();
  const auto kinds = scenes_of(plan);
  CHECK(kinds == scenes_of(plan));
  CHECK_FALSE(std::is_sorted(kinds.begin(), kinds.end(),
                             [](const auto& a, const auto& b) { return a.kind < b.kind; }));
  plan.seed = 12;
  CHECK(kinds != scenes_of(plan));
}

TEST_CASE("the data set generator refuses contradictory settings and existing files") {
  const Folder folder;
  Plan plan = small_plan();
  const std::string path = folder / "run.sqlite";
  plan.conditions.target_z_min_m = 5;
  CHECK_THROWS_AS(write_dataset(plan, {path, "", 1, true}), Error);
  CHECK_FALSE(std::filesystem::exists(path));
  plan.conditions.target_z_max_m = 5;
  plan.people = 1;
  plan.letters = plan.two_people = plan.empty = 0;
  CHECK(write_dataset(plan, {path, "", 1, true}) == 1);
  CHECK_THROWS_AS(write_dataset(plan, {path, "", 1, true}), Error);
}

namespace {

// Returns all rows of a table as a string.
std::string rows_of(const std::string& path, const std::string& table) {
  const std::string columns = sql(path,
                                  "SELECT group_concat('quote(' || name || ')', ' || '' '' || ') "
                                  "FROM pragma_table_info('" +
                                      table + "')");
  return sql(path, "SELECT " + columns + " FROM " + table);
}

}  // namespace

TEST_CASE("the parts of a data set together contain the records of the complete one, bit for bit") {
  const Folder folder;
  Plan plan = small_plan();
  plan.people = 11, plan.letters = 6, plan.two_people = plan.empty = 1;
  plan.conditions.radar_antennas = 2;
  const std::string whole = folder / "whole.sqlite";
  write_dataset(plan, {whole, "", 2, true});
  const auto part = [&](int k) { return folder / ("part-" + std::to_string(k) + ".sqlite"); };
  for (int k = 1; k <= 3; ++k) {
    const JobPart job = JobPart::of(std::to_string(k) + "/3");
    CHECK(write_dataset(plan, {part(k), "", 1, true, job}) == job.range(19).size());
  }
  CHECK(record::RunReader(part(2)).count() == 6);
  CHECK(record::RunReader(part(1)).info().uuid != record::RunReader(part(3)).info().uuid);
  CHECK(rows_of(part(1), "record") + rows_of(part(2), "record") + rows_of(part(3), "record") ==
        rows_of(whole, "record"));
  for (const char* table : {"axis", "antenna", "calibration"})
    CHECK(rows_of(part(2), table) == rows_of(whole, table));
}

TEST_CASE(
    "an existing part of a data set is kept, and a different run of the same name is refused") {
  const Folder folder;
  Plan plan;
  plan.people = 4, plan.letters = 0;
  const std::string path = folder / "a.sqlite";
  const auto write = [&](const char* part) {
    return write_dataset(plan, {path, "", 1, true, JobPart::of(part)});
  };
  CHECK(write("1/2") == 2);
  const auto before = std::filesystem::last_write_time(path);
  CHECK(write("1/2") == 2);
  CHECK(std::filesystem::last_write_time(path) == before);
  for (const char* other : {"2/2", "1/1"})
    check_error(ExitCode::failed,
                "exists already and is not this part of the data set; choose another --out",
                [&] { write(other); });
}
