// SPDX-License-Identifier: MIT
#include "acquire/run/doubt_hook.hpp"

#include "../fixtures/folder.hpp"
#include "../fixtures/record.hpp"
#include "drivers/util/exit_code.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

// Returns the fused record of a 1 s slot. An empty `radar_verdict` means that the slot has no radar
// data.
record::FusedRecord record_of(std::int64_t index, const std::string& radar_verdict) {
  record::FusedRecord r;
  r.index = index;
  r.slot_start = index * 1s, r.slot_end = r.slot_start + 1s;
  r.valid = {Sensor::spd};
  r.sync[Sensor::spd].verdict = test::verdict_of("ok");
  r.sync[Sensor::radar].verdict =
      test::verdict_of(radar_verdict.empty() ? std::string("no frames") : radar_verdict);
  if (!radar_verdict.empty()) r.valid.insert(Sensor::radar);
  return r;
}

constexpr SensorSet both{Sensor::spd, Sensor::radar};

// Alert hook that runs a program. Each run of the program appends a line to a file.
struct Calls {
  explicit Calls(const record::AlertLimits& limits = {}, const std::string& program = {})
      : hook({"sh", "-c",
              program.empty() ? "echo \"$ECHOFUSE_SOURCE $ECHOFUSE_DOUBT $ECHOFUSE_RECORD "
                                "$ECHOFUSE_TEXT $ECHOFUSE_RUN $1\" >>'" +
                                    file + "'"
                              : program,
              "sh", "two  words; $(id)"},
             limits, [this](const std::string& text) { warnings.push_back(text); }) {}
  // Updates the hook at the virtual time `now` until all waiting programs have had time to finish.
  void finish(HostTime now = 0s) {
    for (int i = 0; i < 100; ++i) {
      hook.update(now);
      std::this_thread::sleep_for(2ms);
    }
  }
  std::vector<std::string> lines() const {
    std::ifstream in(file);
    std::vector<std::string> out;
    for (std::string line; std::getline(in, line);) out.push_back(line);
    return out;
  }
  test::Folder folder;
  std::string file = folder / "calls";
  std::vector<std::string> warnings;
  DoubtHook hook;
};

}  // namespace

TEST_CASE("the on_doubt alert program is called once per change of verdict, without a shell") {
  Calls calls;
  const char* verdicts[] = {"ok", "weak: 3 clicks", "weak: 4 clicks", "", "ok"};
  for (std::int64_t i = 0; i < 5; ++i) {
    calls.hook.take(record_of(i, verdicts[i]), both, "/runs/a.sqlite");
    calls.finish();
  }
  CHECK(calls.lines() ==
        std::vector<std::string>{"radar weak 1 weak: 3 clicks /runs/a.sqlite two  words; $(id)",
                                 "radar no data 3 no frames /runs/a.sqlite two  words; $(id)",
                                 "radar ok 4 ok /runs/a.sqlite two  words; $(id)"});
  CHECK(calls.warnings.empty());
}

TEST_CASE(
    "the on_doubt program is called after a set time without data, or if free disk space falls "
    "below a set limit") {
  Calls calls({.after_s = 2.5, .disk_free_gb = 1});
  for (std::int64_t i = 0; i < 5; ++i) {
    calls.hook.take(record_of(i, i == 0 ? "ok" : ""), both, "/runs/a");
    calls.hook.take_disk(i < 4 ? 1'000'000'000 : 999'000'000, {}, "/runs/a");
  }
  calls.finish();
  CHECK(calls.lines() ==
        std::vector<std::string>{"radar no data 3 no frames /runs/a two  words; $(id)",
                                 "disk low  999 MB free, limit 1.0 GB /runs/a two  words; $(id)"});
}

TEST_CASE(
    "the on_doubt program is not called for a signal near a limit, and once if it gets worse") {
  Calls calls({.after_s = 2});
  for (std::int64_t i = 0; i < 20; ++i)
    calls.hook.take(record_of(i, i % 2 ? "weak: 1" : "ok"), both, "/runs/a");
  calls.finish();
  CHECK(calls.lines().empty());
  for (std::int64_t i = 20; i < 30; ++i)
    calls.hook.take(record_of(i, i % 2 ? "weak: 1" : "lossy: 60 %"), both, "/runs/a");
  calls.finish();
  CHECK(calls.lines() ==
        std::vector<std::string>{"radar lossy 20 lossy: 60 % /runs/a two  words; $(id)"});
}

TEST_CASE("the on_doubt program reports a sensor that never delivers data after the set time") {
  Calls calls({.after_s = 2});
  for (std::int64_t i = 0; i < 4; ++i) calls.hook.take(record_of(i, ""), both, "/runs/a");
  calls.finish();
  CHECK(calls.lines() ==
        std::vector<std::string>{"radar no data 1 no frames /runs/a two  words; $(id)"});
}

TEST_CASE(
    "an on_doubt program and its child processes are killed after 10 s before the next starts") {
  Calls calls({}, "sleep 60 & sleep 60");
  for (const char* verdict : {"weak: 1", "ok"})
    calls.hook.take(record_of(0, verdict), both, "/runs/a");
  calls.finish(0s);
  CHECK(calls.warnings.empty());
  calls.finish(10s + 1ms);  // after 10 s the first program is killed and the second program starts
  REQUIRE(calls.warnings.size() == 1);
  CHECK(calls.warnings[0].find("was killed after 10 s") != std::string::npos);
  calls.finish(21s);
  CHECK(calls.warnings.size() == 2);
}

TEST_CASE("failures of the on_doubt program are reported, and a missing program is refused") {
  Calls calls({}, "exit 7");
  calls.hook.take(record_of(0, "weak: 1"), both, "/runs/a");
  calls.finish();
  REQUIRE(calls.warnings.size() == 1);
  CHECK(calls.warnings[0].find("exit code 7") != std::string::npos);
  CHECK_THROWS_AS(DoubtHook({"/none/alert.sh"}, {}, {}), Error);
  CHECK_THROWS_AS(DoubtHook({"no-such-program-anywhere"}, {}, {}), Error);
}

TEST_CASE(
    "at most 16 verdict changes wait for the on_doubt program, and dropped ones are reported") {
  Calls calls;
  for (std::int64_t i = 0; i < 20; ++i)
    calls.hook.take(record_of(i, i % 2 ? "ok" : "weak: 1"), both, "/runs/a");
  REQUIRE(calls.warnings.size() == 4);
  CHECK(calls.warnings[0] ==
        "alert.on_doubt: radar weak was not reported because too many changes are waiting");
}

TEST_CASE(
    "at the end of a run, waiting verdict changes are passed to the on_doubt program or reported") {
  SECTION("an on_doubt program that exits soon receives all waiting verdict changes") {
    Calls calls;
    calls.hook.take(record_of(0, "weak: 1"), both, "/runs/a");
    calls.hook.take_disk(1, {}, "/runs/a");
    calls.hook.finish(0s);
    CHECK(calls.lines().size() == 2);
    CHECK(calls.warnings.empty());
  }
  SECTION(
      "verdict changes that are not passed on because the on_doubt program hangs are reported") {
    Calls calls({}, "sleep 30");
    calls.hook.take(record_of(0, "weak: 1"), both, "/runs/a");
    calls.hook.take_disk(1, {}, "/runs/a");
    calls.hook.finish(0s);
    REQUIRE(calls.warnings.size() == 2);
    CHECK(calls.warnings[0].find("1 changes were not reported") != std::string::npos);
    CHECK(calls.warnings[1].find("was killed because the run ended") != std::string::npos);
  }
}
