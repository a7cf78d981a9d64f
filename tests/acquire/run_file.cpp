// SPDX-License-Identifier: MIT
#include "../fixtures/full_disk.hpp"
#include "acquire/record/network_file_system.hpp"
#include "testing.hpp"

using namespace echofuse::record;

TEST_CASE("records can be read while a run is being written and after it is closed") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  auto second = small_record(1);
  second.valid = SensorSet::from_bits(5);
  const auto run = a_small_run(0).open(path);
  run->append(small_record(0));
  run->append(second);
  {
    const RunReader live(path);
    CHECK(live.info().status == "open");
    CHECK(live.count() == 2);
    check_same(live.read(0), small_record(0));
    // A reader does not block the writer, and finds records that are appended while it is open.
    run->append(small_record(2));
    CHECK(live.count() == 3);
  }
  run->close("complete");
  for (const char* beside : {"-wal", "-lock"}) CHECK_FALSE(fs::exists(path + beside));
  const RunReader read(path);
  CHECK(read.info().status == "complete");
  power(second).clear();  // invalid radar data are not stored, so the expected record has none
  check_same(read.read(1), second);
  check_same(read.read(2), small_record(2));
  CHECK(read.check().empty());
}

TEST_CASE("the summary of a run contains counts of records, losses, tags and labels") {
  const Folder folder;
  constexpr auto back = std::chrono::hours(24);
  const std::string path = a_small_run(5)
                               .each([&](FusedRecord& r) {
                                 if (r.index == 4) lose(r, Sensor::depth);
                                 if (r.index == 2) set_verdict(r, Sensor::spd, "weak: 98 clicks");
                                 if (r.index > 1)
                                   r.slot_utc -= back;  // the system clock was set back
                               })
                               .write(folder / "a.sqlite");
  const RunSummary sum = RunReader(path).summary();
  CHECK(sum.all_valid == 4);
  const std::map<VerdictKind, std::int64_t> weak{{VerdictKind::ok, 4}, {VerdictKind::weak, 1}};
  CHECK(sum.verdicts.by_sensor[Sensor::spd] == weak);
  CHECK(sum.valid == std::array<std::int64_t, 3>{5, 5, 4});
  CHECK(sum.lost == std::array<std::int64_t, 3>{0, 5, 10});
  CHECK(sum.tags == 5 * 1000 + 10);
  CHECK(sum.labels == std::map<std::string, std::int64_t>{{"letter:A", 2}, {"person", 3}});
  CHECK(sum.first_utc == small_record(0).slot_utc);
  CHECK(sum.last_utc == small_record(4).slot_utc - back + std::chrono::nanoseconds(1000));
}

TEST_CASE("a run ended by a full disk keeps its committed records and stores the reason") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  {
    const FullDisk disk(512 * 1024);
    const auto writer = a_small_run(0).open(path);
    check_error(ExitCode::disk, path, [&] {
      for (std::int64_t i = 0; i < 100'000; ++i) writer->append(small_record(i));
    });
  }
  const RunReader run(path);
  CHECK(run.count() > 10);
  CHECK(counts(run.read(run.count() - 1)) == counts(small_record(run.count() - 1)));
  CHECK(run.check().empty());
}

TEST_CASE("files that are not run files are refused, and the reason is reported") {
  const Folder folder;
  const auto refuses = [](const std::string& path, const std::string& words) {
    check_error(ExitCode::failed, words, [&] { RunReader run(path); });
  };
  write_file(folder / "empty", "");
  refuses(folder / "empty", "is empty: the recording process was killed before the first record, ");
  damage(folder / "other", "table of another program");
  refuses(folder / "other", "not an echofuse run file");
  const std::string run = a_small_run(1).write(folder / "run");
  refuses(damaged(run, folder / "bad", "without the table late"), "has no table late");
  for (const char* change : {"extra column", "column of another type"})
    refuses(damaged(run, folder / "bad", change), "does not have the expected definition");
}

TEST_CASE("a run neither overwrites a file nor leaves one if it fails to start") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", other = folder / "b.sqlite";
  check_error(ExitCode::disk, "no/a.sqlite", [&] { a_small_run().write(folder / "no/a.sqlite"); });
  const auto refused = [&](const std::string& words, const RunWriter::Begin& begin) {
    check_error(ExitCode::failed, words, [&] { RunWriter run(path, {}, system_clock, begin); });
    CHECK_FALSE(fs::exists(path + "-new"));
  };
  refused(path, [&](RunWriter&) { fs::create_directory(path + "-shm"); });
  CHECK_FALSE(fs::exists(path));
  fs::remove(path + "-shm");
  a_small_run(3).write(other);
  refused("exists already", [&](RunWriter&) { fs::copy_file(other, path); });
  refused("exists already", {});
  CHECK(contents(path) == contents(other));
}

TEST_CASE("an invalid record is refused, and the error contains the record number") {
  const Folder folder;
  const std::string path = a_small_run(4).write(folder / "a.sqlite");
  const auto [change, expected] = GENERATE(table<const char*, const char*>(
      {{"radar bin 2 is NaN in record ?1", "radar bin 2 is not a finite number"},
       {"histogram of two bytes in record ?1", "spd has 2 bytes, but its axis requires 32"},
       {"depth image is not deflated in record ?1", "depth is not a deflated image of 3 x 2"},
       {"number of the last depth frame is ?2 in record ?1", "depth_last is -1"}}));
  damage(path, change, {2, -1});
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
  // The last type is ext4, which is not a network file system.
  const unsigned types[] = {0x6969,     0xff534d42, 0x01021997, 0x786f4256, 0x0bd00bd0,
                            0x47504653, 0x19830326, 0xaad7aaea, 0xef53};
  std::string names;
  for (const unsigned type : types) names += network_of_type(type) + ";";
  CHECK(names == "NFS;SMB;9p;vboxsf;Lustre;GPFS;BeeGFS;Panasas;;");
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
  for (const char* device : {"8:17", "0:33", "9:9"}) CHECK(mounted(device).empty());
  const Folder folder;
  const std::string path = a_small_run(3).write(folder / "a.sqlite");
  CHECK(network_of(path).empty());
  CHECK(network_of("/nowhere/at/all").empty());
  CHECK(RunReader(path, "NFS").count() == 3);
  CHECK_FALSE(std::filesystem::exists(path + "-shm"));
  const std::string open = folder / "open.sqlite";
  const auto live = a_small_run(0).open(open);
  CHECK(RunReader(open).count() == 0);
  check_error(
      ExitCode::failed,
      "is on a network file system (NFS) and is being written, or was not closed; its last ",
      [&] { RunReader run(open, "NFS"); });
}
