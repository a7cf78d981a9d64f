// SPDX-License-Identifier: MIT
#include "acquire/run/new_run.hpp"

#include <signal.h>

#include "acquire/record/annotate.hpp"
#include "acquire/record/catalogue.hpp"
#include "acquire/record/run_names.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;

TEST_CASE("a run name may contain dots, but percent signs only in time fields such as %Y") {
  const Folder folder;
  for (const char* name : {"gain1.5", "T=4.2K", "2026.11.25", "scan_0.5mm"}) {
    const std::string file = folder / name + ".sqlite";
    CHECK(record::new_run(folder / name) == file);
    CHECK(record::new_run(file) == file);
    CHECK(record::next_of(folder / name) == folder / name + "-001.sqlite");
  }
  CHECK(has(record::new_run("%Y%m%d-%H%M%S"), "/20"));
  CHECK(record::new_run("/50%%").ends_with("/50%.sqlite"));
  for (const char* name : {"laser_50%_gain", "50%", "50%gain", "100% on"})
    check_error(ExitCode::usage, "is not a supported time field; expected %Y,",
                [&] { record::new_run(name); });
}

TEST_CASE("the name of the next run file contains the next free number or the time") {
  const Folder folder;
  write_file(folder / "monday-007.sqlite", "");
  CHECK(record::next_of(folder / "monday") == folder / "monday-008.sqlite");
  const std::string dated = record::next_of(folder / "at-%Y");
  CHECK(dated == record::new_run(folder / "at-%Y"));
  write_file(dated, "");
  CHECK(record::next_of(folder / "at-%Y") == dated.substr(0, dated.size() - 7) + "-001.sqlite");
}

TEST_CASE("a run is refused if its time stamps would overflow") {
  using std::chrono::years;
  CHECK(error_of([] { refuse_late_clock(UtcTime::max() - years(10)); }).first == ExitCode::ok);
  CHECK(has(check_error(ExitCode::failed, "the system clock is at 2260-",
                        [] { refuse_late_clock(UtcTime::max() - years(2)); }),
            "set the clock"));
}

TEST_CASE("a run killed while being created leaves a complete file or none, and can be recreated") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  Config config;
  config.calibration.entries = {{Sensor::spd, "2026", "plate", 1, 0.1, 0.01}};
  for (int kill = 0; kill < 12; ++kill) {
    const std::string seen = kill % 2 ? path : path + "-new";
    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
      const auto run = make_run(config, path, {}, "", system_clock);
      ::pause();
      ::_exit(0);
    }
    for (int i = 0; i < 100'000 && !fs::exists(seen) && !fs::exists(path); ++i)
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    std::this_thread::sleep_for(std::chrono::microseconds(kill * 100));
    ::kill(child, SIGKILL);
    REQUIRE(waitpid(child, nullptr, 0) == child);
    if (!fs::exists(path)) continue;
    const record::RunReader run(path);
    CHECK(run.info().status.starts_with("crashed"));
    CHECK(run.calibrations() == config.calibration.entries);
    for (const char* beside : {"", "-wal", "-shm"}) fs::remove(path + beside);
  }
  write_file(path + "-new", "what a kill left");
  {
    const auto other = a_small_run(0).open(folder / "b.sqlite");
    // Creates a -wal file for which no run file exists.
    fs::copy_file(folder / "b.sqlite-wal", path + "-wal");
  }
  make_run(config, path, {}, "", system_clock)->close("complete");
  CHECK(record::RunReader(path).axes().empty());
  CHECK_FALSE(fs::exists(path + "-new"));
}

TEST_CASE("the device counters of a run are written completely or not at all") {
  const Folder folder;
  const auto run = a_small_run(0).open(folder / "a.sqlite");
  sql(folder / "a.sqlite", "CREATE UNIQUE INDEX once ON counter (name)");
  const std::vector<record::CounterRow> counted{{"spd", "a", 1}, {"radar", "a", 2}};
  CHECK(has(error_of([&] { run->put_counters(counted); }).second, "UNIQUE"));
  sql(folder / "a.sqlite", "DROP INDEX once");
  CHECK(record::RunReader(folder / "a.sqlite").counters().empty());
}

TEST_CASE("SQLite VACUUM INTO copies a run while it is being recorded") {
  const Folder folder;
  const auto run = a_small_run(3).open(folder / "a.sqlite");
  sql(folder / "a.sqlite", "VACUUM INTO '" + folder / "copy.sqlite" + "'");
  run->append(small_record(3));
  const record::RunReader copy(folder / "copy.sqlite");
  CHECK(copy.count() == 3);
  CHECK(copy.info().status == record::copy_of_open);
  record::put_note(folder / "copy.sqlite", "door", "me");
  CHECK(record::RunReader(folder / "copy.sqlite").info().status == record::copy_of_open);
  run->close("complete");
  CHECK(record::RunReader(folder / "a.sqlite").count() == 4);
}

TEST_CASE("reading a run header takes only slightly longer than opening the file in SQLite") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  a_small_run(3).write(path);
  const auto cpu_s = [](const auto& body) {
    double best = 1e9;
    for (int round = 0; round < 5; ++round) {
      const std::clock_t begun = std::clock();
      for (int i = 0; i < 50; ++i) body();
      best = std::min(best, static_cast<double>(std::clock() - begun) / CLOCKS_PER_SEC);
    }
    return best;
  };
  const double ours_s = cpu_s([&] { record::entry_of(record::RunReader(path)); });
  const double opened_s = cpu_s([&] { sql(path, "SELECT 1 FROM record"); });
  CAPTURE(ours_s, opened_s);
  CHECK(ours_s < 8 * opened_s);
}
