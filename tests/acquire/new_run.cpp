// SPDX-License-Identifier: MIT
#include "acquire/run/new_run.hpp"

#include <signal.h>
#include <unistd.h>

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
    for (int i = 0; i < 100'000 && !fs::exists(seen) && !fs::exists(path); ++i) ::usleep(100);
    ::usleep(static_cast<useconds_t>(kill * 100));
    ::kill(child, SIGKILL);
    REQUIRE(waitpid(child, nullptr, 0) == child);
    if (!fs::exists(path)) continue;
    const record::RunReader run(path);
    CHECK(run.info().status.starts_with("crashed"));
    CHECK(run.calibrations() == config.calibration.entries);
    for (const char* beside : {"", "-wal", "-shm"}) fs::remove(path + beside);
  }
  write_file(path + "-new", "what a kill left");
  const auto other = a_small_run(0).open(folder / "b.sqlite");
  // Creates a -wal file for which no run file exists.
  fs::copy_file(folder / "b.sqlite-wal", path + "-wal");
  make_run(config, path, {}, "", system_clock)->close("complete");
  CHECK(record::RunReader(path).axes().empty());
  CHECK_FALSE(fs::exists(path + "-new"));
}

TEST_CASE("the device counters of a run are written completely or not at all") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto run = a_small_run(0).open(path);
  sql(path, "CREATE UNIQUE INDEX once ON counter (name)");
  const std::vector<record::CounterRow> counted{{"spd", "a", 1}, {"radar", "a", 2}};
  CHECK(has(error_of([&] { run->put_counters(counted); }).second, "UNIQUE"));
  CHECK(sql(path, "DROP INDEX once; SELECT count(*) FROM counter") == "0\n");
}
