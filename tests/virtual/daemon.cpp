// SPDX-License-Identifier: MIT
// Tests events and records of a run with devices that connect, disconnect and fail, in virtual
// time.
#include <map>
#include <set>

#include "../fixtures/error.hpp"
#include "acquire/import/import.hpp"
#include "bench.hpp"

using namespace echofuse::test;
using sim::FaultKind;
using namespace std::chrono_literals;

TEST_CASE(
    "a run without device faults has a complete record for each slot and no lost or late data") {
  Bench b;
  const auto all = b.record(40);
  REQUIRE(all.size() == 40);
  b.check_slots(3s);
  std::set<std::vector<float>> profiles;
  for (const auto& r : all) {
    CHECK(r.valid.bits() == 7);
    for (const Sensor s : all_sensors) {
      CHECK(verdict(r, s) == "ok");
      CHECK(r.sync[s].lost == 0);
    }
    CHECK(r.sync[Sensor::radar].used == 12);
    profiles.insert(power(r));
  }
  CHECK(profiles.size() == 40);
  CHECK(b.reader().events().empty());
  CHECK(b.reader().info().status == "complete");
}

TEST_CASE(
    "a run continues if all devices are unplugged, and records are complete once they return") {
  Bench b({.faults = {fault("tdc", FaultKind::unplug, 30, 30),
                      fault("radar", FaultKind::unplug, 30, 30),
                      fault("depth", FaultKind::unplug, 30, 30)}});
  const auto all = b.record(40);
  b.check_slots(3s);
  REQUIRE(all.size() == 40);
  const auto silent = std::ranges::count_if(all, [](auto& r) { return r.valid.empty(); });
  CHECK(silent >= 8);  // eight of the ten slots contain no data at all
  CHECK(silent <= 9);
  for (const auto& r : all)
    if (r.valid.empty()) {
      CHECK(verdict(r, Sensor::spd) == "no tags");
      CHECK(verdict(r, Sensor::radar) == "no frames");
      CHECK(verdict(r, Sensor::depth) == "no frames");
    }
  CHECK(all.front().valid.bits() == 7);
  CHECK(all.back().valid.bits() == 7);
  for (const char* sensor : {"spd", "radar", "depth"}) {
    CHECK(has(b.events(sensor), "not connected to"));
    // The number of events must not grow with the number of connection attempts.
    CHECK(b.events(sensor).size() <= 8);
  }
}

TEST_CASE("missing and unconfigured devices have different verdicts") {
  Bench b;
  b.unplug_radar();
  b.lab->set({"depth.address="});
  for (const auto& r : b.record(4)) {
    CHECK(r.valid.bits() == 1);
    CHECK(verdict(r, Sensor::radar) == "no frames");
    CHECK(verdict(r, Sensor::depth) == "not configured");
  }
  CHECK(has(b.events("radar"), "no data at the start"));
}

TEST_CASE("records that lack data of a required device are incomplete") {
  Bench b({.faults = {fault("radar", FaultKind::unplug, 30, 15)}, .radar_required = true});
  const auto all = b.record(20);
  const auto incomplete = std::ranges::count_if(all, [](auto& r) { return !r.has(Sensor::radar); });
  CHECK(incomplete >= 4);
  CHECK(b.reader().summary().incomplete == incomplete);
  CHECK(b.reader().summary().policies.at("radar") == "required");
}

TEST_CASE("a raw capture with faults and reconnections reproduces the live run bit for bit") {
  // Slots of 3 s are aligned to multiples of their length. Slots longer than 10 s are not.
  const double window_s = GENERATE(3.0, 12.0);
  Bench b({.window_s = window_s,
           .faults = {fault("tdc", FaultKind::unplug, 30, 5),
                      fault("tdc", FaultKind::corrupt, 40, 10, 0.05),
                      fault("radar", FaultKind::unplug, 50, 5),
                      fault("radar", FaultKind::garbage, 60, 5, 40),
                      fault("depth", FaultKind::unplug, 70, 5)}});
  b.lab->set({"run.folder=runs"});
  auto run = b.run(12);
  run.keep_raw = b.folder / "raw";
  run.countdown_s = 2;
  CHECK(b.lab->record(run) == ExitCode::ok);
  REQUIRE(acquire::is_kept(run.keep_raw));
  // The configuration in a raw capture contains no run folder, so that the capture can be imported
  // on any machine.
  CHECK(acquire::kept_config(run.keep_raw, {}).run_folder.empty());
  acquire::import_kept(acquire::kept_config(run.keep_raw, {}), run.keep_raw,
                       b.folder / "again.sqlite");
  const record::RunReader again(b.folder / "again.sqlite");
  const auto live = b.records();
  REQUIRE(again.count() == 12);
  for (const auto& a : live) {
    const auto r = again.read(a.index);
    CAPTURE(a.index);
    CHECK(r.slot_start == a.slot_start);
    CHECK(r.slot_utc == a.slot_utc);
    CHECK(difference(r, a) == "");
    CHECK(r.valid.bits() == a.valid.bits());
    for (const Sensor s : all_sensors) CHECK(verdict(r, s) == verdict(a, s));
  }
  // Imports the same photons again, with different histogram settings.
  acquire::import_kept(acquire::kept_config(run.keep_raw, {"tdc.bins=10", "depth.address="}),
                       run.keep_raw, b.folder / "short.sqlite");
  CHECK(counts(record::RunReader(b.folder / "short.sqlite").read(0)) ==
        std::vector(counts(live[0]).begin(), counts(live[0]).begin() + 10));
  // Imports the same bytes again with slots of half the length. Each live slot then has two
  // records.
  acquire::import_kept(
      acquire::kept_config(run.keep_raw, {"run.window_s=" + std::to_string(window_s / 2)}),
      run.keep_raw, b.folder / "half.sqlite");
  const record::RunReader half(b.folder / "half.sqlite");
  REQUIRE(half.count() == 24);
  for (const auto& a : live) {
    const auto first = half.read(2 * a.index), second = half.read(2 * a.index + 1);
    CHECK(first.slot_start == a.slot_start);
    CHECK(second.slot_end == a.slot_end);
    CHECK(first.spd_counts.starts + second.spd_counts.starts == a.spd_counts.starts);
  }
}

TEST_CASE("a raw capture that has no slot, has missing bytes or has damaged times is refused") {
  Bench b;
  auto run = b.run(2);
  run.keep_raw = b.folder / "raw";
  CHECK(b.lab->record(run) == ExitCode::ok);
  const auto import = [&] {
    acquire::import_kept(acquire::kept_config(run.keep_raw, {}), run.keep_raw,
                         b.folder / "x.sqlite");
  };
  // An empty text deletes the file.
  const auto [name, text, why] = GENERATE(table<std::string, std::string, const char*>(
      {{"tags.times", "1000000000 open 0\n1000000000 bytes 99999999999\n",
        "tags.times: lists more bytes than tags-001.blocks contains; one of the files is "
        "truncated"},
       {"tags.times", "1000000000 open\n",
        "tags.times: expected TIME WHAT VALUE, found \"1000000000 open\""},
       {"radar.times", "", "contains only one of radar.times and radar-cli.times"},
       {"run.times", "0 start 1\n", "run.times: the raw capture has no complete slot"},
       {"run.times", "0 start 1\n9223372036854775807 slots 1000000000\n",
        "expected TIME WHAT VALUE, found \"9223372036854775807 slots 1000000000\""},
       // The first slot begins years after the start of the run.
       {"run.times",
        "0 start 0\n1000000000000000000 slots 1000000000\n1000000001000000000 closed 0\n",
        "run.times: the first slot begins 1000000000.000000 s after the start of the run"}}));
  std::ofstream(run.keep_raw + "/" + name) << text;
  if (text.empty()) std::filesystem::remove(run.keep_raw + "/" + name);
  CHECK_THAT(refusal_by(import, ExitCode::failed), Catch::Contains(why));
  // A rejected raw capture must not leave a run file behind.
  for (const auto& file : std::filesystem::directory_iterator(b.folder.path))
    CHECK(file.path().filename().string().find("x.sqlite") == std::string::npos);
}

TEST_CASE("the option --countdown of the run command delays the first slot") {
  const auto first = [](std::int64_t countdown_s) {
    Bench b({.window_s = 1});
    auto run = b.run(2);
    run.countdown_s = countdown_s;
    CHECK(b.lab->record(run) == ExitCode::ok);
    CHECK(b.verdicts(Sensor::radar) == Strings(2, "ok"));
    return b.records().at(0).slot_start;
  };
  CHECK(first(5) - first(0) == std::chrono::seconds(5));
}

TEST_CASE("a weak laser is reported once and counted in each record") {
  Bench b({.signal_photons = 100});
  auto run = b.run(6);
  run.strict = true;
  CHECK(b.lab->record(run) == ExitCode::partial);
  CHECK(b.verdicts(Sensor::spd) == Strings(6, "weak"));
  CHECK(b.verdicts(Sensor::radar) == Strings(6, "ok"));
  CHECK(b.events("spd").size() == 1);
}

TEST_CASE("a fading laser, a frozen camera and a frozen radar are each reported once") {
  Bench b({.faults = {fault("tdc", FaultKind::gain, 60, 15, 0.03),
                      fault("depth", FaultKind::freeze, 90, 15),
                      fault("radar", FaultKind::freeze, 120, 15)},
           .assignments = "[signal]\nspd_clicks = 0\nclicks_per_pulse = 0\n"});
  b.record(60);
  const std::map<Sensor, std::string> kinds = {
      {Sensor::spd, "weak"}, {Sensor::depth, "stands still"}, {Sensor::radar, "stands still"}};
  for (const auto& [sensor, kind] : kinds) {
    const Strings all = b.verdicts(sensor);
    CAPTURE(name_of(sensor));
    // At least three slots of 3 s lie entirely within the 15 s fault.
    CHECK(std::ranges::count(all, kind) >= 3);
    CHECK(std::ranges::count(all, kind) <= 5);
    CHECK(std::ranges::count(all, "ok") + std::ranges::count(all, kind) == 60);
    const Strings events = b.events(name_of(sensor));
    REQUIRE(events.size() == 2);
    CHECK(events[0].find(kind + ": ") != std::string::npos);
    CHECK(events[1].ends_with(": ok"));
  }
}

TEST_CASE("simulated scenes change at slot boundaries") {
  Bench b({.window_s = 1,
           .hold_s = 1,
           .scenes = "[[scene]]\nkind = \"person\"\nx_m = 0.0\nz_m = 3.0\nyaw_deg = 0.0\n"
                     "[[scene]]\nkind = \"person\"\nx_m = 0.0\nz_m = 4.0\nyaw_deg = 0.0\n"});
  b.record(30);
  const auto border = static_cast<std::size_t>((3.5 * 2 / 0.299792458e-3 - 13343) / 100);
  std::vector<double> near;
  for (const auto& r : b.records()) {
    const auto sum = [](auto from, auto to) { return std::accumulate(from, to, 0.0); };
    near.push_back(sum(counts(r).begin(), counts(r).begin() + static_cast<std::ptrdiff_t>(border)) /
                   sum(counts(r).begin(), counts(r).end()));
  }
  for (std::size_t i = 5; i + 1 < near.size(); ++i) {  // the clock fit is valid from record 5 on
    // The person is always entirely on one side of 3.5 m. Less than 15 % of the counts, caused by
    // the background, are on the other side.
    CHECK(std::min(near[i], 1 - near[i]) < 0.15);
    CHECK((near[i] > 0.5) != (near[i + 1] > 0.5));
  }
}

TEST_CASE("slots keep their length when the system clock is changed") {
  constexpr auto day = 24h;
  Bench b;
  port::Timer forward(b.lab->loop), back(b.lab->loop);
  forward.after(30s, [&] { b.lab->loop.step_utc(day); });
  back.after(60s, [&] { b.lab->loop.step_utc(-2 * day); });
  b.record(40);
  b.check_slots(3s);
  const Strings told = b.events("clock");
  REQUIRE(told.size() == 2);
  for (const auto& text : told) CHECK(text.starts_with("the system clock was set"));
  std::vector<double> steps;
  const auto all = b.records();
  for (std::size_t k = 0; k + 1 < all.size(); ++k)
    if (const auto step = all[k + 1].slot_utc - all[k].slot_utc - 3s; std::chrono::abs(step) > 1s)
      steps.push_back(seconds(step));
  CHECK(steps == std::vector<double>{seconds(day), seconds(-2 * day)});
}

TEST_CASE("a run is refused if the system clock is near the limit of 64-bit time stamps") {
  Bench b;
  b.lab->loop.step_utc(24h * 365 * 237);
  CHECK_THROWS_WITH(b.lab->record(b.run(1)), Catch::Contains("the system clock is at 226"));
}

TEST_CASE("a disconnected device stays locked against another run") {
  Bench b({.faults = {fault("radar", FaultKind::unplug, 20, 30)}});
  std::string refused;
  port::Timer other(b.lab->loop);
  other.after(40s, [&] {
    acquire::RunOptions second = b.run(1);
    second.out = b.folder / "second.sqlite";
    refused = error_of([&] { b.lab->record(second); }).second;
  });
  b.record(20);
  CHECK(refused.find("radar serial:") != std::string::npos);
  CHECK(refused.find("in use by echofuse-acquire run") != std::string::npos);
}

TEST_CASE("a camera that reconnects with another axis is not used, but other devices are") {
  Bench b({.faults = {fault("depth", FaultKind::unplug, 20, 6)}});
  port::Timer meanwhile(b.lab->loop);
  meanwhile.after(23s, [&] { b.lab->turn_camera(); });
  b.record(20);
  CHECK(b.records().front().valid.bits() == 7);
  CHECK(b.records().back().valid.bits() == 3);
  CHECK(has(b.events("depth"), "its axes differ from those at the start of the run"));
}

TEST_CASE(
    "frames of a radar that reconnects with another clock are assigned to slots by that clock") {
  const double by_s = GENERATE(-10.0, -0.4, 2.0, 10.0);
  CAPTURE(by_s);
  Bench b({.faults = {fault("radar", FaultKind::unplug, 20, 10),
                      fault("radar", FaultKind::clock_offset, 25, 1000, by_s)}});
  b.record(20);
  CHECK(b.reader().late()[Sensor::radar] == 0);
  for (const auto& r : b.records())
    if (r.index > 10) CHECK(r.sync[Sensor::radar].used == 12);
}
