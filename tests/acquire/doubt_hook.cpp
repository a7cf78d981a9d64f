// SPDX-License-Identifier: MIT
#include "acquire/run/doubt_hook.hpp"

#include "../fixtures/folder.hpp"
#include "../fixtures/record.hpp"
#include "drivers/util/exit_code.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

namespace {

constexpr SensorSet both{Sensor::spd, Sensor::radar};

// Returns the fused record of a 1 s slot. An empty `radar_verdict` means that the slot has no radar
// data.
record::FusedRecord record_of(std::int64_t index, const std::string& radar_verdict) {
  record::FusedRecord r;
  r.index = index;
  r.slot_start = index * 1s, r.slot_end = r.slot_start + 1s;
  r.valid = both;
  test::set_verdict(r, Sensor::spd, "ok"), test::set_verdict(r, Sensor::radar, radar_verdict);
  if (radar_verdict.empty()) test::lose(r, Sensor::radar, "no frames");
  return r;
}

// Alert hook that runs a shell script, which appends its environment to a file.
struct Calls {
  explicit Calls(const record::AlertLimits& limits = {}, const std::string& script = {})
      : hook({"sh", "-c", script.empty() ? report : script, file, "two  words; $(id)"}, limits,
             [this](const std::string& text) { warnings.push_back(text); }) {}
  // Sends the records of a run, one per verdict of the radar.
  void send(const std::vector<std::string>& verdicts) {
    for (std::size_t i = 0; i < verdicts.size(); ++i)
      hook.take(record_of(static_cast<std::int64_t>(i), verdicts[i]), both, "/runs/a");
  }
  // Updates the hook at the virtual time `now` until all waiting programs have had time to finish.
  void update(HostTime now) {
    for (int i = 0; i < 100; ++i) {
      hook.update(now);
      std::this_thread::sleep_for(2ms);
    }
  }
  static constexpr const char* report =
      "echo \"$ECHOFUSE_SOURCE $ECHOFUSE_DOUBT $ECHOFUSE_RECORD $ECHOFUSE_TEXT $ECHOFUSE_RUN "
      "$ECHOFUSE_UTC $1\" >>\"$0\"";
  test::Folder folder;
  std::string file = folder / "calls";
  std::vector<std::string> warnings;
  DoubtHook hook;
};

}  // namespace

TEST_CASE("the on_doubt program is called once per lasting change of verdict, without a shell") {
  // Each row contains a time limit, the verdicts of the radar, and the expected calls.
  struct Row {
    double after_s;
    std::vector<std::string> verdicts, calls;
  };
  const auto [after_s, verdicts, calls] =
      GENERATE(Row{0,
                   {"ok", "weak: 3 clicks", "weak: 4 clicks", "", "ok"},
                   {"radar weak 1 weak: 3 clicks", "radar no data 3 no frames", "radar ok 4 ok"}},
               Row{2.5, {"ok", "", "", "", ""}, {"radar no data 3 no frames"}},
               Row{2, {"", "", "", ""}, {"radar no data 1 no frames"}},
               // a signal near a limit, which then gets worse
               Row{2, {"ok", "weak: 1", "ok", "weak: 1", "ok"}, {}},
               Row{2,
                   {"weak: 1", "ok", "weak: 1", "lossy: 60 %", "weak: 1", "lossy: 60 %"},
                   {"radar lossy 3 lossy: 60 %"}});
  Calls alert({.after_s = after_s});
  alert.send(verdicts);
  alert.hook.finish(0s);
  std::string expected;
  for (const std::string& call : calls)
    expected += call + " /runs/a 1970-01-01T00:00:00.000Z two  words; $(id)\n";
  CHECK(test::contents(alert.file) == expected);
  CHECK(alert.warnings.empty());
}

TEST_CASE("the on_doubt program is called if the free disk space crosses its limit") {
  Calls calls({.disk_free_gb = 1});
  for (const std::uint64_t free : {1'000'000'000u, 999'000'000u, 998'000'000u, 2'000'000'000u})
    calls.hook.take_disk(free, 0s, "/runs/a");
  calls.hook.take_disk({}, 0s, "/runs/a");
  calls.hook.finish(0s);
  const std::string end = " /runs/a 1970-01-01T00:00:00.000Z two  words; $(id)\n";
  CHECK(test::contents(calls.file) ==
        "disk low  999 MB free, limit 1.0 GB" + end + "disk ok  2.0 GB free, limit 1.0 GB" + end);
}

TEST_CASE("an on_doubt program is killed with its child processes after 10 s") {
  Calls calls({}, "sleep 60 & sleep 60");
  calls.send({"weak: 1", "ok"});
  for (const auto& [now, warnings] : {std::pair{0s, 0u}, {10s, 0u}, {11s, 1u}, {22s, 2u}}) {
    calls.update(now);
    CHECK(calls.warnings.size() == warnings);
  }
  CHECK_THAT(calls.warnings.at(0), Catch::Contains("was killed after 10 s"));
}

TEST_CASE("failures of the on_doubt program are reported, and a missing program is refused") {
  for (const auto& [script, words] :
       {std::pair{"exit 7", "ended with exit code 7"}, {"kill -9 $$", "was ended by signal 9"}}) {
    Calls calls({}, script);
    calls.send({"weak: 1"});
    calls.hook.finish(0s);
    CHECK(calls.warnings == std::vector{std::string("alert.on_doubt: sh ") + words});
  }
  for (const char* program : {"/none/alert.sh", "no-such-program-anywhere"})
    CHECK_THROWS_AS(DoubtHook({program}, {}, {}), Error);
}

TEST_CASE("at most 16 changes wait for the on_doubt program, and dropped ones are reported") {
  Calls calls;
  for (int i = 0; i < 10; ++i) calls.send({"weak: 1", "ok"});
  REQUIRE(calls.warnings.size() == 4);
  CHECK(calls.warnings[0] ==
        "alert.on_doubt: radar weak was not reported because too many changes are waiting");
}

TEST_CASE("changes that the on_doubt program has not received at the end are reported") {
  Calls calls({}, "sleep 30");
  calls.send({"weak: 1"});
  calls.hook.take_disk(1, {}, "/runs/a");
  calls.hook.finish(0s);
  REQUIRE(calls.warnings.size() == 2);
  CHECK_THAT(calls.warnings[0], Catch::Contains("1 changes were not reported"));
  CHECK_THAT(calls.warnings[1], Catch::Contains("was killed because the run ended"));
}
