// SPDX-License-Identifier: MIT
// Tests slot times: UTC after the system clock is set, and invalid times in a run file.

#include "acquire/commands/commands.hpp"
#include "acquire/run/journal.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;
using namespace std::chrono_literals;

TEST_CASE("a change of the system clock during a run is stored, and later UTC times are correct") {
  const auto step = GENERATE(24h, -24h);
  const Folder folder;
  const std::string path = folder / "run.sqlite";
  const std::chrono::nanoseconds before = 1'700'000'000s;
  port::VirtualLoop loop(before);
  loop.run_for(1000s - loop.now());
  Journal journal(a_small_run(0).open(path), loop);
  RunLog log(loop);
  log.attach(journal);
  for (int second = 0; second < 60; ++second, loop.run_for(1s)) journal.refresh_anchor(log);
  loop.step_utc(10ms);  // a step too small to be reported as an event
  journal.refresh_anchor(log);
  CHECK(journal.utc_of(1050s) == 1050s + before + 10ms);
  loop.run_for(10s + 200ms);
  loop.step_utc(step - 10ms);
  journal.refresh_anchor(log);
  journal.refresh_anchor(log);
  CHECK(journal.utc_of(1069s) == 1069s + before + 10ms);
  CHECK(journal.utc_of(1070s) == 1070s + before + 10ms);  // the slot began before the clock was set
  CHECK(journal.utc_of(1071s) == 1071s + before + step);
  loop.run_for(69s + 800ms);
  loop.step_utc(20ms);
  journal.refresh_anchor(log);
  CHECK(journal.utc_of(1140s) == 1140s + before + step + 20ms);
  journal.finish("complete");

  const std::string day = step > 0h ? "2023-11-15" : "2023-11-13";
  CHECK(record::RunReader(path).events().at(0).utc == day + "T22:31:10.200Z");
  CHECK(events_of(path) ==
        std::vector<std::string>{"warning clock: the system clock was set, or the machine was "
                                 "suspended: UTC jumped from 2023-11-14T22:31:10.210Z to " +
                                 day + "T22:31:10.200Z; later slots use the new time"});
  std::vector<std::chrono::nanoseconds> offsets;
  for (const record::Anchor& a : record::RunReader(path).anchors())
    offsets.push_back(a.utc - a.mono);
  CHECK(offsets == std::vector{before, before + 10ms, before + step, before + step + 20ms});
}

TEST_CASE("all run readers refuse slot times that overflow, with a one-line error") {
  const Folder folder;
  const std::string path = a_small_run(4).write(folder / "a.sqlite");
  const std::string change = GENERATE(
      as<std::string>(), "record 3 has the last UTC", "record 3 has the first UTC",
      "record 3 has an UTC of 1e300", "record 3 lasts from the first to the last time",
      "record 3 lasts from the last to the first time", "record 3 lasts from 0 to the last time");
  CAPTURE(change);
  damage(path, change);
  const record::RunReader run(path);
  const std::function<void()> reads[] = {[&] { run.read(3); }, [&] { run.outlines(0); },
                                         [&] { run.summary(); }};
  for (const auto& read : reads)
    check_error(ExitCode::failed, "a.sqlite: record 3: its slot is from ", read);
  std::vector<std::int64_t> good, bad;
  run.for_each([&](const FusedRecord& r) { return good.push_back(r.index), true; }, 0,
               [&](std::int64_t index, const std::string&) { bad.push_back(index); });
  CHECK(good == std::vector<std::int64_t>{0, 1, 2});
  CHECK(bad == std::vector<std::int64_t>{3});
}

TEST_CASE("the annotate command reports no time for a note if the slot length is invalid") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  record::RunInfo info;
  info.window_s = GENERATE(1e300, INFINITY, -1, 0, NAN);
  const auto run = a_small_run(1).info(info).open(path);
  const std::string number = info.window_s > 0 ? "record 1" : "the current record";
  CHECK(has(annotate_run(path, "hello", {}), "noted in " + number));
}
