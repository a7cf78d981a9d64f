// SPDX-License-Identifier: MIT
// The files of a run in parts: whole or not there, in their order, told apart from what is only
// named like them.
#include "acquire/record/run_parts.hpp"

#include <signal.h>
#include <unistd.h>

#include <ctime>
#include <nlohmann/json.hpp>
#include <thread>

#include "acquire/commands/commands.hpp"
#include "acquire/record/catalogue.hpp"
#include "acquire/record/run_names.hpp"
#include "acquire/record/writer_lock.hpp"
#include "acquire/run/resume.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace testing;

namespace {

const record::CalibrationEntry calibration{Sensor::spd, "2026-11-21T10:00:00Z", "m", 1, 0.07, 1e-5};
const record::Antennas antennas{{0, 0, 1, 0}, {1, 0, 1.5, -0.25}};

// Parts of three records each.
struct Parts {
  Folder folder;

  std::string path(std::int64_t number, const std::string& name = "a") const {
    return record::part_path(folder / (name + ".sqlite"), number);
  }
  void begin(std::int64_t number = 1, const std::string& name = "a") const {
    record::RunInfo info;
    info.window_s = 1;
    info.meta = record::meta_of({number, 3});
    info.meta.emplace_back("lens", "50mm");
    info.first_index = 3 * (number - 1);
    fill(std::make_unique<record::RunWriter>(path(number, name), info, system_clock,
                                             [](record::RunWriter& run) {
                                               run.put_calibration(calibration);
                                               run.put_antennas(antennas);
                                               for (const auto& axis : small_axes())
                                                 run.put_axis(axis);
                                             }));
  }
  static void fill(std::unique_ptr<record::RunWriter> run) {
    for (int i = 0; i < 3; ++i) run->append(small_record(run->next_index()));
    run->close("complete");
  }
  std::unique_ptr<record::RunWriter> next(std::int64_t number,
                                          const std::string& name = "a") const {
    return record::next_part(path(number, name), number + 1, 3 * number, system_clock);
  }
  void go_on(std::int64_t number, const std::string& name = "a") const { fill(next(number, name)); }
  std::vector<record::RunEntry> runs() const {
    std::vector<record::RunEntry> files;
    for (const auto& [place, file] : record::run_files(folder / ""))
      if (fs::file_size(file) > 1000) files.push_back(record::entry_of(record::RunReader(file)));
    return record::runs_of(std::move(files));
  }
};

}  // namespace

TEST_CASE("a part has what the run was begun with, and its first record's index") {
  const Parts parts;
  parts.begin();
  parts.go_on(1);
  const record::RunReader first(parts.path(1)), second(parts.path(2));
  CHECK(second.info().uuid == first.info().uuid);
  CHECK(second.calibrations() == std::vector{calibration});
  CHECK(second.antennas() == antennas);
  CHECK(second.axes().size() == 4);
  CHECK(second.outlines(0).at(0).index == 3);
  CHECK(second.info().first_index == 3);
  record::RunWriter(parts.path(2)).close("complete");
  CHECK(record::RunReader(parts.path(2)).info().first_index == 3);
  const record::Part is = record::part_of(parts.path(2), second.info());
  CHECK(is.number == 2);
  CHECK(is.records == 3);
}

TEST_CASE("a part whose making is killed is there whole or not at all, and is made again") {
  const Parts parts;
  parts.begin();
  const std::string next = parts.path(2);
  for (int kill = 0; kill < 12; ++kill) {
    const std::string seen = kill % 2 ? next : next + "-new";
    const pid_t child = fork();
    REQUIRE(child >= 0);
    if (child == 0) {
      const auto run = parts.next(1);
      ::pause();
      ::_exit(0);
    }
    for (int i = 0; i < 100'000 && !fs::exists(seen) && !fs::exists(next); ++i)
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    std::this_thread::sleep_for(std::chrono::microseconds(kill * 100));
    ::kill(child, SIGKILL);
    REQUIRE(waitpid(child, nullptr, 0) == child);
    if (!fs::exists(next)) continue;
    const record::RunReader part(next);
    CHECK(part.info().status.starts_with("crashed"));
    CHECK(part.info().first_index == 3);
    CHECK(part.calibrations() == std::vector{calibration});
    CHECK(part.axes().size() == 4);
    for (const char* beside : {"", "-wal", "-shm"}) fs::remove(next + beside);
  }
  write_file(next + "-new", "what a kill left");
  parts.begin(1, "b");
  {
    record::RunWriter other(parts.path(1, "b"));
    other.append(small_record(7));
    fs::copy_file(parts.path(1, "b") + "-wal", next + "-wal");  // without its run
  }
  parts.go_on(1);
  CHECK(record::RunReader(next).count() == 3);
  CHECK_FALSE(fs::exists(next + "-new"));
}

TEST_CASE("a part that is missing, damaged or of another run is named with its records") {
  const Parts parts;
  parts.begin();
  for (const int part : {1, 2, 3}) parts.go_on(part);
  const auto files = [&] { return record::files_of(parts.folder / "a"); };
  CHECK(files().paths.size() == 4);
  CHECK(files().missing.empty());
  const std::string none = ": not there, or not of this run";
  SECTION("in the middle") {
    fs::remove(parts.path(2));
    SECTION("not there") {}
    SECTION("damaged") { write_file(parts.path(2), "no database"); }
    SECTION("of another run") {
      parts.begin(2, "b");
      fs::copy_file(parts.path(2, "b"), parts.path(2));
    }
    SECTION("a copy of another one") { fs::copy_file(parts.path(1), parts.path(2)); }
    CHECK(files().paths == std::vector{parts.path(1), parts.path(3), parts.path(4)});
    CHECK(files().missing == parts.path(2) + none + "; records 3 to 5 are missing");
    CHECK(parts.runs().at(0).missing == files().missing);
  }
  SECTION("two at the beginning") {
    for (const int part : {1, 2}) fs::remove(parts.path(part));
    CHECK(files().paths == std::vector{parts.path(3), parts.path(4)});
    CHECK(files().missing ==
          parts.path(1) + " to " + parts.path(2) + none + "; records 0 to 5 are missing");
  }
  SECTION("at the end, where it is in the way of the run") {
    write_file(parts.path(5), "no database");
    CHECK(files().paths.size() == 4);
    CHECK(files().missing == parts.path(5) + none);
    const auto [code, text] = error_of(
        [&] { acquire::refuse_resuming(record::RunReader(parts.path(4)), acquire::Config{}); });
    CHECK(code == ExitCode::failed);
    CHECK(has(text, "is not the last part of its run, behind it stands " + parts.path(5)));
  }
}

TEST_CASE("a part that another program continued meanwhile is not resumed, and stays as it is") {
  const Parts parts;
  parts.begin();
  static_cast<void>(acquire::reopen_run(parts.path(1), system_clock, [](const auto& begun) {
    CHECK(record::WriterLock::someone_writes(begun.path()));  // nobody else can, from now on
  }));
  record::recover(parts.path(1));
  parts.go_on(1);
  const auto size = fs::file_size(parts.path(1));
  const auto [code, text] =
      error_of([&] { static_cast<void>(acquire::reopen_run(parts.path(1), system_clock)); });
  CHECK(code == ExitCode::failed);
  CHECK(has(text, "is not the last part of its run, behind it stands " + parts.path(2)));
  CHECK(record::RunReader(parts.path(1)).info().status == "crashed");  // as recover() left it
  CHECK(fs::file_size(parts.path(1)) == size);
}

TEST_CASE(
    "parts are in the order of their numbers, whatever the clock said and the names sort like") {
  const Parts parts;
  parts.begin(999);
  parts.go_on(999);
  sql(parts.path(999), "UPDATE run SET started_utc = '2026-11-24T08:00:00.000Z'");
  sql(parts.path(1000), "UPDATE run SET started_utc = '2026-11-23T08:00:00.000Z'");
  CHECK(record::files_of(parts.folder / "a").paths ==
        std::vector{parts.path(999), parts.path(1000)});
  const auto runs = parts.runs();
  REQUIRE(runs.size() == 1);
  CHECK(runs[0].files == std::vector{parts.path(999), parts.path(1000)});
  CHECK(runs[0].info.started_utc == "2026-11-24T08:00:00.000Z");
  CHECK(runs[0].sum.records == 6);
  CHECK(runs[0].sum.last_index == 2999);
}

TEST_CASE("a run is listed by its name, and what is only named like a part of it by itself") {
  const Parts parts;
  parts.begin();
  CHECK(parts.runs().at(0).name() == "a");
  for (const int part : {1, 2}) parts.go_on(part);
  fs::copy_file(parts.path(2), parts.folder / "copy.sqlite");
  fs::remove(parts.path(2));
  parts.begin(2, "b");
  fs::copy_file(parts.path(2, "b"), parts.path(2));
  std::vector<std::string> told;
  for (const auto& run : parts.runs())
    told.push_back(run.name() + " " + std::to_string(run.sum.records) + " " +
                   std::to_string(run.files.size()));
  CHECK(told == std::vector<std::string>{"a 6 2", "a-002 3 1", "b 3 1", "copy 3 1"});
  CHECK(record::run_of(parts.folder / "copy.sqlite") == parts.folder / "copy.sqlite");
  CHECK(acquire::reopen_run(parts.folder / "copy.sqlite", system_clock).part_records == 0);
  CHECK(acquire::reopen_run(parts.path(3), system_clock).part_end == 9);
}

TEST_CASE("a number of a part without the records of a full one makes no part") {
  const Parts parts;
  parts.begin();
  for (const int part : {1, 2}) parts.go_on(part);
  sql(parts.path(2), "UPDATE run SET meta = json_remove(meta, '$.part_records')");
  CHECK(record::part_of(parts.path(2), record::RunReader(parts.path(2)).info()).number == 0);
  CHECK(record::run_of(parts.path(2)) == parts.path(2));
  CHECK(record::files_of(parts.folder / "a").paths == std::vector{parts.path(1), parts.path(3)});
}

TEST_CASE("the last part of a run is found from the end, past what is only named like one") {
  const Parts parts;
  parts.begin();
  for (const int part : {1, 2}) parts.go_on(part);
  const auto last = [&] { return record::last_file_of(parts.folder / "a"); };
  CHECK(last() == parts.path(3));
  write_file(parts.path(5), "no database");
  parts.begin(4, "b");
  fs::copy_file(parts.path(4, "b"), parts.path(4));
  CHECK(last() == parts.path(3));
  CHECK(record::last_file_of(parts.path(2)) == parts.path(2));
  CHECK(record::last_file_of(parts.folder / "none") == parts.folder / "none.sqlite");
  fs::copy_file(parts.path(1), parts.folder / "a.sqlite");
  CHECK(last() == parts.folder / "a.sqlite");
}

TEST_CASE("info of a run in parts holds the records of all") {
  const Parts parts;
  parts.begin();
  for (const int part : {1, 2}) parts.go_on(part);
  record::put_note(parts.path(1), "at the beginning", "me");
  const std::vector<std::string> files = record::files_of(parts.folder / "a").paths;
  const auto told = nlohmann::json::parse(acquire::describe_run(files, true));
  CHECK(told["file"] == parts.folder / "a.sqlite");
  CHECK(told["files"] == files);
  CHECK(told["records"] == 9);
  CHECK(told["valid"]["spd"] == 9);
  CHECK(told["marks"][0]["text"] == "at the beginning");
  CHECK(told["axes"].size() == 4);
  CHECK(told["started_utc"] == record::RunReader(parts.path(1)).info().started_utc);
  CHECK(has(acquire::describe_run(files, false), "a.sqlite: 9 records, complete\n  parts     3, "));
}

TEST_CASE("a name of a run may hold points, and no percent sign but that of a time") {
  const Parts parts;
  for (const char* name : {"gain1.5", "T=4.2K", "2026.11.25", "scan_0.5mm"}) {
    const std::string file = parts.folder / name + ".sqlite";
    CHECK(record::new_run(parts.folder / name) == file);
    CHECK(record::new_run(file) == file);
    CHECK(record::part_path(file, 2) == parts.folder / name + "-002.sqlite");
    parts.begin(1, name);
    parts.go_on(1, name);
    CHECK(record::files_of(parts.folder / name).paths.size() == 2);
  }
  CHECK(parts.runs().size() == 4);
  CHECK(has(record::new_run("%Y%m%d-%H%M%S"), "/20"));
  CHECK(record::new_run("/50%%").ends_with("/50%.sqlite"));
  for (const char* name : {"laser_50%_gain", "50%", "50%gain", "100% on"}) {
    const auto [code, text] = error_of([&] { record::new_run(name); });
    CHECK(code == ExitCode::usage);
    CHECK(has(text, "is no field of the time; expected %Y,"));
  }
}

// Before, the tables that a run may have were made anew for each file.
TEST_CASE("to look into a run costs little more than SQLite needs to open it") {
  const Parts parts;
  parts.begin();
  const std::string path = parts.path(1);
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
