// SPDX-License-Identifier: MIT
#include <signal.h>
#include <sqlite3.h>
#include <sys/resource.h>
#include <unistd.h>

#include "acquire/record/network_file_system.hpp"
#include "acquire/record/recover.hpp"
#include "testing.hpp"

using namespace echofuse::record;

namespace {

// Runs `body` in a child process and returns the process ID of the child. The child exits with code
// 1 if `body` throws, and with code 0 otherwise.
template <class Body>
pid_t in_child(Body body) {
  const pid_t child = fork();
  if (child != 0) return child;
  try {
    body();
  } catch (...) {
    _exit(1);
  }
  _exit(0);
}

}  // namespace

TEST_CASE("records can be read while a run is being written and after it is closed") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  RunInfo info;
  info.window_s = 0.2;
  info.config_text = "[run]\n# a comment\n";
  info.radar_cfg = "sensorStart\n";
  info.operator_name = "Ada";
  const auto open = a_small_run(0).info(info).open(path);
  RunWriter& run = *open;
  run.put_device({.sensor = Sensor::radar,
                  .address = "serial:/dev/x",
                  .model = "M",
                  .serial = "7",
                  .firmware = "3.5",
                  .axes = {}});
  run.put_event(UtcTime(0), Severity::warning, "radar", "no frames");
  auto second = small_record(1);
  second.valid = SensorSet::from_bits(5);
  run.append(small_record(0));
  run.append(second);
  {
    const RunReader live(path);
    CHECK(live.info().status == "open");
    CHECK(live.count() == 2);
    check_same(live.read(0), small_record(0));
    // A reader does not block the writer, and finds records that are appended while it is open.
    run.append(small_record(2));
    CHECK(live.count() == 3);
  }
  run.close("complete");
  CHECK_FALSE(fs::exists(path + "-wal"));
  CHECK_FALSE(fs::exists(path + "-lock"));

  const RunReader read(path);
  CHECK(read.info().status == "complete");
  CHECK(read.info().window_s == 0.2);
  CHECK(read.info().config_text == info.config_text);
  CHECK(read.info().radar_cfg == info.radar_cfg);
  CHECK(read.info().operator_name == "Ada");
  CHECK(read.axes().size() == 4);
  CHECK(same_axis(*read.axis("radar"), small_axes()[1]));
  CHECK(read.devices().at(0).firmware == "3.5");
  CHECK(read.events().at(0).text == "no frames");
  power(second).clear();  // invalid radar data are not stored, so the expected record has none
  check_same(read.read(1), second);
  check_same(read.read(2), small_record(2));
  CHECK(read.check().empty());
}

TEST_CASE("the summary of a run contains counts of records, losses, tags and labels") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  a_small_run(5)
      .each([](FusedRecord& r) {
        if (r.index == 4) lose(r, Sensor::depth);
      })
      .write(path);
  const RunSummary sum = RunReader(path).summary();
  CHECK(sum.records == 5);
  CHECK(sum.all_valid == 4);
  CHECK(sum.valid == std::array<std::int64_t, 3>{5, 5, 4});
  CHECK(sum.lost == std::array<std::int64_t, 3>{0, 5, 10});
  CHECK(sum.tags == 5 * 1000 + 10);
  CHECK(sum.labels == std::map<std::string, std::int64_t>{{"letter:A", 2}, {"person", 3}});
  CHECK(sum.first_utc == small_record(0).slot_utc);
  CHECK(sum.last_utc == small_record(4).slot_utc + std::chrono::nanoseconds(1000));
}

TEST_CASE("committed records are readable after the writing program was killed by SIGKILL") {
  const Folder folder;
  for (int round = 0; round < 8; ++round) {
    const std::string path = folder / (std::to_string(round) + ".sqlite");
    int acknowledged[2];
    REQUIRE(pipe(acknowledged) == 0);
    const pid_t child = in_child([&] {
      const auto run = a_small_run(0).open(path);
      for (std::int64_t i = 0;; ++i) {
        run->append(small_record(i));
        if (write(acknowledged[1], &i, sizeof i) < 0) return;
      }
    });
    close(acknowledged[1]);
    std::int64_t last = -1;
    while (last < 10 + 7 * round) REQUIRE(read(acknowledged[0], &last, sizeof last) == sizeof last);
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    while (read(acknowledged[0], &last, sizeof last) == sizeof last) {
    }
    close(acknowledged[0]);

    const RunReader run(path);
    CHECK(run.info().status == "crashed");
    CHECK(run.count() >= last + 1);
    CHECK(run.count() <= last + 2);  // one more record may be committed but not yet acknowledged
    std::int64_t next = 0;
    run.for_each([&](const FusedRecord& r) {
      REQUIRE(r.index == next);
      REQUIRE(counts(r) == counts(small_record(next++)));
      return true;
    });
    CHECK(next == run.count());
  }
  const std::string path = folder / "0.sqlite";
  const auto count = RunReader(path).count();
  recover(path);
  CHECK(RunReader(path).info().status == "crashed");
  CHECK(RunReader(path).count() == count);
  CHECK_FALSE(fs::exists(path + "-wal"));
}

TEST_CASE("a run ended by a full disk keeps its committed records and stores the reason") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const pid_t child = in_child([&] {
    signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{512 * 1024, 512 * 1024};
    setrlimit(RLIMIT_FSIZE, &limit);
    const auto run = a_small_run(0).open(path);
    const auto [code, text] = error_of([&] {
      for (std::int64_t i = 0; i < 100'000; ++i) run->append(small_record(i));
    });
    if (code != ExitCode::disk || !has(text, path)) throw 0;
  });
  int status = 0;
  waitpid(child, &status, 0);
  CHECK(WEXITSTATUS(status) == 0);
  const RunReader run(path);
  CHECK(run.count() > 10);
  CHECK(counts(run.read(run.count() - 1)) == counts(small_record(run.count() - 1)));
  CHECK(run.check().empty());
}

TEST_CASE("invalid run files and output files are refused, and the reason is reported") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto refuses = [&](const std::string& words) {
    check_error(ExitCode::failed, words, [&] { RunReader run(path); });
  };
  SECTION("an empty run file is refused") {
    write_file(path, "");
    refuses("is empty: the recording process was killed before the first record, or");
  }
  SECTION("the database of another program is refused") {
    damage(path, "table of another program");
    refuses("not an echofuse run file");
  }
  SECTION("a file with a missing table, an extra column or another column type is refused") {
    a_small_run(1).write(path);
    for (const char* change :
         {"without the table late", "extra column", "column of another type"}) {
      damaged(path, folder / "b.sqlite", change);
      const std::string text = error_of([&] { RunReader run(folder / "b.sqlite"); }).second;
      CHECK((has(text, "has no table late") || has(text, "does not have the expected definition")));
    }
  }
  SECTION("an existing file is not overwritten") {
    write_file(path, "precious");
    check_error(ExitCode::failed, "exists already", [&] { a_small_run().write(path); });
    CHECK(fs::file_size(path) == 8);
  }
  SECTION("a file that another program creates at the same time is not overwritten") {
    a_small_run(3).write(folder / "b.sqlite");
    check_error(ExitCode::failed, "exists already", [&] {
      const auto copy = [&](RunWriter&) { fs::copy_file(folder / "b.sqlite", path); };
      RunWriter run(path, {}, system_clock, copy);
    });
    CHECK(contents(path) == contents(folder / "b.sqlite"));
    CHECK_FALSE(fs::exists(path + "-new"));
  }
  SECTION("a run that fails to start leaves no file") {
    check_error(ExitCode::failed, path, [&] {
      RunWriter run(path, {}, system_clock,
                    [&](RunWriter&) { fs::create_directory(path + "-shm"); });
    });
    CHECK_FALSE(fs::exists(path));
  }
  SECTION("a run in a missing folder is refused") {
    check_error(ExitCode::disk, "no/a.sqlite",
                [&] { a_small_run().write(folder / "no/a.sqlite"); });
  }
}

TEST_CASE("an invalid record is refused, and the error contains the record number") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  a_small_run(4).write(path);
  const auto [change, values, expected] = GENERATE(table<const char*, std::vector<Value>,
                                                         const char*>(
      {{"radar bin 2 is NaN in record ?1", {2}, "radar bin 2 is not a finite number"},
       {"histogram of two bytes in record ?1", {2}, "spd has 2 bytes, but its axis requires 32"},
       {"depth image is not deflated in record ?1", {2}, "depth is not a deflated image of 3 x 2"},
       {"number of the last depth frame is ?2 in record ?1", {2, -1}, "depth_last is -1"}}));
  damage(path, change, values);
  const RunReader run(path);
  const auto visit_all = [](const FusedRecord&) { return true; };
  CHECK(
      has(error_of([&] { run.for_each(visit_all); }).second, std::string("record 2: ") + expected));
  const RunReader::InParallel backwards = [](std::size_t count, const auto& work) {
    while (count-- > 0) work(count);
  };
  for (const auto& in_parallel : {RunReader::InParallel(), backwards}) {
    std::vector<std::int64_t> good, bad;
    run.for_each(
        [&](const FusedRecord& r) {
          CHECK(depth_mm(r) == depth_mm(small_record(r.index)));
          good.push_back(r.index);
          return true;
        },
        0, [&](std::int64_t index, const std::string&) { bad.push_back(index); },
        {Sensor::spd, Sensor::radar, Sensor::depth}, in_parallel);
    CHECK(good == std::vector<std::int64_t>{0, 1, 3});
    CHECK(bad == std::vector<std::int64_t>{2});
  }
}

TEST_CASE("a record that does not match the axes of its run is not written") {
  const auto [change, words] = GENERATE(table<void (*)(FusedRecord&), const char*>(
      {{[](FusedRecord& r) { counts(r).pop_back(); }, "spd has 23 values, but its axis has 24"},
       {[](FusedRecord& r) { power(r).pop_back(); }, "radar has 3 values, but its axis has 4"},
       {[](FusedRecord& r) { antenna_data(r) = {1}; }, "array has 1 values, but its axis has 328"},
       {[](FusedRecord& r) { depth_mm(r).pop_back(); },
        "depth has 5 values, but its axis has 6"}}));
  const Folder folder;
  const RunBuilder whole = a_small_run(1).zones(Zones(3)).antennas(Antennas(8));
  const auto run = RunBuilder(whole).records(0).open(folder / "a.sqlite");
  check_error(ExitCode::failed, std::string("record 0: ") + words,
              [&] { run->append(RunBuilder(whole).each(change).made()); });
  run->append(whole.made());
  CHECK(run->records() == 1);
}

TEST_CASE("network file systems are recognised, and only closed runs are read from them") {
  for (const auto& [type, name] : {std::pair{0x6969u, "NFS"},
                                   {0xff534d42u, "SMB"},
                                   {0x0bd00bd0u, "Lustre"},
                                   {0x01021997u, "9p"},
                                   {0x786f4256u, "vboxsf"},
                                   {0xef53u, ""}})  // ext4 is not a network file system
    CHECK(network_of_type(type) == name);
  const auto mounted = [](const std::string& device) {
    std::istringstream lines(
        "36 27 0:31 / /mnt/host rw,relatime shared:1 - virtiofs data rw\n"
        "37 27 0:32 / /mnt/lab rw,nosuid - fuse.sshfs lab@nas:/runs rw,user_id=0\n"
        "38 27 8:17 / /mnt/stick rw - fuseblk /dev/sdb1 rw\n"
        "39 27 0:33 / /mnt/joined rw - fuse.mergerfs a:b rw\n");
    return record::network_of_mount(lines, device);
  };
  CHECK(mounted("0:31") == "virtiofs");
  CHECK(mounted("0:32") == "sshfs");
  CHECK(mounted("8:17").empty());
  CHECK(mounted("0:33").empty());
  CHECK(mounted("9:9").empty());
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  CHECK(network_of(path).empty());
  CHECK(network_of("/nowhere/at/all").empty());
  a_small_run(3).write(path);
  CHECK(RunReader(path, "NFS").count() == 3);
  CHECK_FALSE(std::filesystem::exists(path + "-shm"));
  const std::string open = folder / "open.sqlite";
  const auto live = a_small_run(0).open(open);
  CHECK(RunReader(open).count() == 0);
  CHECK_THROWS_WITH(RunReader(open, "NFS"),
                    Catch::Contains("is on a network file system (NFS) and is being written, or "
                                    "was not closed; its last records are in ") &&
                        Catch::Contains("copy both files to a local disk"));
}
