// SPDX-License-Identifier: MIT
// Tests that run --every writes consecutive run files without losing a slot.
#include <map>
#include <set>

#include "../acquire/testing.hpp"
#include "bench.hpp"
#include "recon/live/followed_run.hpp"

using sim::FaultKind;
using test::Bench;
using namespace std::chrono_literals;

namespace {

// Run options for a run that is written to the files 1.sqlite, 2.sqlite and so on.
struct Rotation {
  acquire::RunOptions options;
  std::vector<std::string> files;

  Rotation(const Bench& b, std::int64_t count, std::int64_t slots_a_file) : options(b.run(count)) {
    options.out = b.folder / "1.sqlite";
    options.slots_a_file = slots_a_file;
    options.next_out = [&b, n = 1]() mutable {
      return b.folder / (std::to_string(++n) + ".sqlite");
    };
    options.opened = [this](const std::string& file) { files.push_back(file); };
  }
  Rotation(const Rotation&) = delete;
  Rotation& operator=(const Rotation&) = delete;
};

std::map<std::string, std::uint64_t> counters_of(const std::string& file) {
  std::map<std::string, std::uint64_t> out;
  for (const auto& c : record::RunReader(file).counters()) out[c.source + ' ' + c.name] = c.value;
  return out;
}

// Returns the number of late tags of each record, and 0 for records without late tags.
std::vector<std::int64_t> late_tags_of(const std::string& file) {
  std::istringstream lines(
      sql(file,
          "SELECT coalesce((SELECT spd FROM late WHERE late.idx = record.idx), 0) FROM record "
          "ORDER BY idx"));
  return {std::istream_iterator<std::int64_t>(lines), {}};
}

}  // namespace

TEST_CASE("file rotation loses no slot, and each file is a complete run") {
  Bench whole, b;
  CHECK(whole.lab->record(whole.run(10)) == ExitCode::ok);
  Rotation rotation(b, 10, 4);
  CHECK(b.lab->record(rotation.options) == ExitCode::ok);
  REQUIRE(rotation.files.size() == 3);
  const auto expected = whole.records();
  std::set<std::string> uuids;
  std::size_t slot = 0;
  for (const std::string& file : rotation.files) {
    std::int64_t index = 0;
    for (const auto& r : records_of(file)) {
      CHECK(r.index == index++);
      CHECK(r.slot_utc == expected.at(slot).slot_utc);
      CHECK(r.valid == expected[slot].valid);
      CHECK(difference(r, expected[slot]) == "");
      ++slot;
    }
    const record::RunReader run(file), first(rotation.files[0]);
    uuids.insert(run.info().uuid);
    CHECK(run.info().status == "complete");
    CHECK(run.info().config_resolved == first.info().config_resolved);
    CHECK(run.axes().size() == first.axes().size());
    CHECK(run.devices().size() == 3);
    CHECK(run.calibrations() == first.calibrations());
    CHECK(run.policies() == first.policies());
    CHECK(run.anchors().size() > 0);
  }
  CHECK(slot == 10);
  CHECK(uuids.size() == 3);
  view::FollowedRun newest(b.folder / "");
  CHECK(newest.refresh());
  CHECK(newest.path() == rotation.files.back());
  std::map<std::string, std::uint64_t> sum;
  for (const std::string& file : rotation.files)
    for (const auto& [name, count] : counters_of(file)) sum[name] += count;
  CHECK(sum == counters_of(whole.folder / "run.sqlite"));
  CHECK(counters_of(rotation.files[1]).at("radar frames") == 4 * 12);
}

TEST_CASE("file rotation creates no empty file, also if the last slots become due together") {
  const bool together = GENERATE(false, true);
  const std::int64_t last = together ? 2 : 4;
  Bench b;
  Rotation rotation(b, 4 + last, 4);
  if (together) rotation.options.kept_closings.assign(6, {b.lab->loop.now() + 120s});
  CHECK(b.lab->record(rotation.options) == ExitCode::ok);
  REQUIRE(rotation.files.size() == 2);
  CHECK(record::RunReader(rotation.files[0]).count() == 4);
  CHECK(record::RunReader(rotation.files[1]).count() == last);
}

TEST_CASE("a device missing at the start of a rotated file is used when it returns") {
  Bench b({.faults = {test::fault("radar", FaultKind::unplug, 20, 30)}});
  Rotation rotation(b, 24, 8);
  CHECK(b.lab->record(rotation.options) == ExitCode::ok);
  REQUIRE(rotation.files.size() == 3);
  const record::RunReader second(rotation.files[1]);
  std::string said;
  for (const auto& e : second.events()) said += e.source + ": " + e.text + '\n';
  CHECK(test::has(said, "radar: no data at the start of the run: "));
  CHECK(records_of(rotation.files[1]).front().valid == SensorSet::from_bits(5));
  CHECK(records_of(rotation.files[2]).back().valid == SensorSet::from_bits(7));
  CHECK(second.axis("radar"));
}

TEST_CASE("late tags are counted in the record of their slot, also after a file rotation") {
  const auto late_tags = [](std::int64_t slots_a_file) {
    Bench b({.window_s = 0.5, .faults = {test::fault("tdc", FaultKind::late, 10, 2, 3)}});
    Rotation rotation(b, 40, slots_a_file);
    CHECK(b.lab->record(rotation.options) == ExitCode::ok);
    std::vector<std::int64_t> all;
    for (const std::string& file : rotation.files)
      std::ranges::copy(late_tags_of(file), std::back_inserter(all));
    return all;
  };
  const auto expected = late_tags(40);
  REQUIRE(expected.size() == 40);
  CHECK(std::ranges::count_if(expected, [](std::int64_t n) { return n > 0; }) >= 2);
  CHECK(late_tags(16) == expected);
}

TEST_CASE("the counters of a run include the samples received before its first slot") {
  Bench b;
  b.record(3);
  const auto counters = counters_of(b.folder / "run.sqlite");
  std::map<std::string, std::uint64_t> used;
  for (const auto& r : b.records()) {
    used["spd"] += r.spd_counts.tags;
    used["radar"] += r.statistics.radar_frames;
    used["depth"] += r.statistics.depth_frames;
  }
  for (const auto& [sensor, items] :
       {std::pair{"spd", "tags"}, {"radar", "frames"}, {"depth", "frames"}}) {
    CAPTURE(sensor);
    const auto count = [&](const std::string& what) { return counters.at(sensor + (" " + what)); };
    CHECK(count("early") > 0);
    CHECK(used[sensor] + count("early") + count("late") + count("outside") == count(items));
  }
}
