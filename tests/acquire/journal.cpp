// SPDX-License-Identifier: MIT
#include "acquire/run/journal.hpp"

#include <spdlog/spdlog.h>

#include <future>

#include "../fixtures/full_disk.hpp"
#include "acquire/record/annotate.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;

namespace {

port::SystemLoop loop;  // provides the clock and the worker threads

// Journal of a run in a folder of its own.
struct Recording {
  explicit Recording(std::size_t capacity = Journal::default_capacity,
                     const RunBuilder& run = a_small_run(0))
      : journal(run.open(path), loop, capacity) {}
  // Starts the next file of the run.
  void rotate() {
    journal.begin_next([to = next] { return a_small_run(0).open(to); });
  }
  void put(std::int64_t from, std::int64_t to) {
    for (std::int64_t i = from; i < to; ++i) journal.put(small_record(i));
  }
  // Waits until all queued jobs are done.
  void wait_for_jobs() {
    std::promise<void> done;
    journal.put([&](record::RunWriter&) { done.set_value(); });
    done.get_future().wait();
  }
  void wait_for_lock() const {
    while (journal.delay_cause() != "another program is writing to the run file")
      std::this_thread::yield();
  }
  void wait_for_failure() const {
    while (!journal.failed()) std::this_thread::yield();
  }
  // Ends the run, and returns a reader of its first file.
  record::RunReader ended() {
    journal.finish("complete");
    return record::RunReader(path);
  }
  // Checks that the end of the run throws an error within 10 s. Returns the message.
  std::string failed_end(ExitCode code, const std::string& words) {
    const auto start = std::chrono::steady_clock::now();
    const std::string text = check_error(code, words, [&] { journal.finish("complete"); });
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(10));
    return text;
  }
  const Folder folder;
  const std::string path = folder / "a.sqlite", next = folder / "b.sqlite";
  Journal journal;
};

// Keeps a write transaction open, as another program writing to the run file would.
struct Holder : OtherProgram {
  explicit Holder(const std::string& path) : OtherProgram(path) { ask("BEGIN IMMEDIATE"); }
  void let_go() {
    ask("COMMIT");
    db.reset();
  }
};

}  // namespace

TEST_CASE("the run journal completes all queued jobs in order before it closes the run") {
  Recording r;
  for (std::int64_t i = 0; i < 30; ++i) {
    CHECK(r.journal.put(small_record(i)));
    r.journal.put([i](record::RunWriter& run) {
      run.put_event(UtcTime(0), Severity::warning, "test", std::to_string(run.records() == i + 1));
    });
  }
  for (int i = 0; i < 2; ++i) r.journal.put_device(device_of(Sensor::radar, {}));  // written once
  r.journal.put_late({{3, {1, 2, 3}}});
  const record::RunReader run = r.ended();
  CHECK(r.journal.path() == r.path);
  CHECK(run.devices().size() == 1);
  CHECK(run.late() == PerSensor<std::int64_t>{1, 2, 3});
  CHECK(r.journal.written() == 30);
  CHECK(run.info().status == "complete");
  CHECK(run.count() == 30);
  CHECK(events_of(r.path) == std::vector<std::string>(30, "warning test: 1"));
}

TEST_CASE("the run journal drops data if the disk is slow and ends the run if the disk stalls") {
  Recording r(2);
  std::promise<void> begun, disk;
  r.journal.put([&begun, wait = disk.get_future().share()](record::RunWriter&) {
    begun.set_value();
    wait.wait();
  });
  begun.get_future().wait();
  for (std::int64_t i = 0; i < 4; ++i) CHECK(r.journal.put(small_record(i)) == (i < 2));
  SECTION("records that wait too long for a slow disk are stored without sensor data") {
    disk.set_value();
    const record::RunReader run = r.ended();
    REQUIRE(run.count() == 4);
    CHECK(run.read(1).valid == SensorSet::from_bits(7));
    CHECK(run.read(2).valid == SensorSet::from_bits(0));
    CHECK(run.read(3).sync[Sensor::depth].verdict.text() == "not stored: disk too slow");
    CHECK(run.read(3).spd_counts.tags == small_record(3).spd_counts.tags);
  }
  SECTION("a stalled disk ends the run with a disk error") {
    r.put(4, 20);
    CHECK_FALSE(r.journal.failed());  // 20 jobs are waiting, which is ten times the capacity
    r.put(20, 30);
    CHECK(r.journal.failed());
    disk.set_value();
    r.failed_end(ExitCode::disk, "disk too slow; its last ");
    CHECK(status_of(r.path) == "stopped:disk");
  }
}

TEST_CASE("a locked run file is reported, and queued records are written later") {
  Recording r(2);
  r.wait_for_jobs();
  Holder holder(r.path);
  CHECK(r.journal.put(small_record(0)));
  r.wait_for_lock();
  for (std::int64_t i = 1; i < 5; ++i) CHECK(r.journal.put(small_record(i)) == (i < 3));
  SECTION("queued records are written if the lock of the run file is released in time") {
    holder.let_go();
    const record::RunReader run = r.ended();
    REQUIRE(run.count() == 5);
    CHECK(run.read(4).sync[Sensor::spd].verdict.text() ==
          "not stored: another program is writing to the run file");
  }
  SECTION("the run ends with an error if the queue is full before the run file is unlocked") {
    r.put(5, 30);
    CHECK(r.journal.failed());
    holder.let_go();
    r.failed_end(ExitCode::disk,
                 "another program is writing to the run file; its last 9 records were not written");
    CHECK(record::RunReader(r.path).count() == 21);
  }
}

TEST_CASE("the run journal stops writing after the first failed job") {
  Recording r;
  r.put(0, 1);
  std::promise<void> disk;
  r.journal.put([wait = disk.get_future().share()](record::RunWriter&) {
    wait.wait();
    throw Error(ExitCode::disk, "no space left");
  });
  r.put(1, 2);
  disk.set_value();
  r.wait_for_failure();
  r.put(2, 3);
  CHECK(r.failed_end(ExitCode::disk, "") == "no space left; its last 2 records were not written");
  const record::RunReader run(r.path);
  CHECK(run.count() == 1);
  CHECK(run.counters().back().name == "unwritten");
  CHECK(run.counters().back().value == 2);
  CHECK(run.events().back().text == "its last 2 records were not written");
  CHECK(run.info().status == "stopped:disk");
}

TEST_CASE("closing a run waits at most two seconds if another program locks the next run file") {
  Recording r;
  r.rotate();
  r.wait_for_jobs();
  const Holder holder(r.next);
  r.put(1, 2);
  r.failed_end(ExitCode::disk, "another program holds a write transaction");
}

TEST_CASE("closing a run waits at most two seconds for the lock of the previous run file") {
  Recording r;
  r.wait_for_jobs();
  Holder holder(r.path);
  r.rotate();
  while (!fs::exists(r.next)) std::this_thread::yield();
  SECTION("the next run ends within two seconds and contains a warning about the previous one") {
    const auto start = std::chrono::steady_clock::now();
    CHECK(r.journal.finish("complete"));
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(10));
    const auto events = events_of(r.next);
    REQUIRE(events.size() == 1);
    CHECK_THAT(events[0], Catch::StartsWith("warning run: " + r.path + ": ") &&
                              Catch::Contains("another program holds a write transaction"));
  }
  SECTION("a label set while the previous file is being closed applies to the next file") {
    r.wait_for_lock();
    holder.ask("INSERT INTO event (level, utc, text) VALUES ('label', '2026', 'door')");
    r.put(1, 2);
    // Writing to the new file does not wait until the old file is closed.
    while (r.journal.written() == 0) std::this_thread::yield();
    holder.let_go();
    while (!r.journal.label()) std::this_thread::yield();
    r.put(2, 3);
    r.journal.finish("complete");
    const record::RunReader next(r.next);
    CHECK(next.read(1).valid == SensorSet::from_bits(7));
    CHECK(next.read(1).label != "door");
    CHECK(next.read(2).label == "door");
    CHECK_THROWS_WITH(record::put_label(r.path, "late", "me"), Catch::Contains("not being record"));
  }
}

TEST_CASE("a run keeps all its records if the next file of the rotation cannot be created") {
  Recording r;
  r.put(0, 1);
  while (r.journal.written() == 0) std::this_thread::yield();
  SECTION("the run stops if the next file exists, and that file is not overwritten") {
    write_file(r.next, "others'");
    r.rotate();
    r.put(1, 2);
    CHECK(has(r.failed_end(ExitCode::failed, r.next + ": exists already"),
              "its last 1 records were not written"));
    CHECK(status_of(r.path) == "stopped:failed");
    CHECK(contents(r.next) == "others'");
  }
  SECTION("the run stops with a disk error if the disk is full") {
    {
      // An empty run needs 12 pages of 4 KiB, which do not fit on this disk.
      const FullDisk disk(40'000);
      r.rotate();
      r.wait_for_failure();
    }
    r.failed_end(ExitCode::disk, "");
    CHECK(status_of(r.path) == "stopped:disk");
    for (const char* left : {"", "-new", "-new-journal"}) CHECK_FALSE(fs::exists(r.next + left));
  }
  CHECK(record::RunReader(r.path).count() == 1);
}

TEST_CASE("a new label applies to the current slot and all later slots") {
  Recording r;
  record::put_label(r.path, "door", "me");
  const UtcTime now = system_clock.utc();
  for (const int end_s : {-1, 1, 2}) {
    record::FusedRecord record = small_record(r.journal.written());
    record.label = "before";
    record.slot_utc = now + std::chrono::seconds(end_s) - (record.slot_end - record.slot_start);
    r.journal.put(record);
    r.wait_for_jobs();
  }
  const record::RunReader run = r.ended();
  CHECK(run.read(0).label == "before");
  CHECK(run.read(1).label == "door");
  CHECK(run.read(2).label == "door");
}

TEST_CASE("a depth image that cannot be stored invalidates only the data of the depth camera") {
  constexpr std::uint32_t width = record::max_depth_pixels + 1;
  Recording r(2, a_small_run(0).depth({"depth_x", "tangent", "1", width, -0.2, 0.2, 1},
                                      {"depth_y", "tangent", "1", 1, 0.1, -0.2, 1}));
  auto record = small_record(0);
  depth_mm(record).assign(width, 1000);
  CHECK(r.journal.put(record));
  const FusedRecord stored = r.ended().read(0);
  CHECK(stored.valid == SensorSet::from_bits(3));
  CHECK(verdict(stored, Sensor::depth) == "not stored: the image cannot be compressed");
  CHECK(power(stored) == power(record));
}

TEST_CASE("the run log is limited to 100 lines per source in 10 s, and dropped lines are counted") {
  Recording r;
  port::VirtualLoop clock;
  RunLog log(clock);
  log.attach(r.journal);
  spdlog::set_level(spdlog::level::off);
  for (int i = 0; i < 250; ++i) log.put(Severity::warning, "radar", "again");
  log.put(Severity::warning, "spd", "once");
  clock.run_for(std::chrono::seconds(10));
  log.put(Severity::warning, "radar", "later");
  spdlog::set_level(spdlog::level::info);
  r.journal.finish("complete");
  std::vector<std::string> expected(100, "warning radar: again");
  expected.insert(expected.end(),
                  {"warning spd: once", "warning radar: 150 log lines dropped (limit 100 in 10 s)",
                   "warning radar: later"});
  CHECK(events_of(r.path) == expected);
}

TEST_CASE("samples that belong to no slot are counted by cause and sensor, and are reported") {
  Recording r;
  RunLog log(loop);
  log.attach(r.journal);
  spdlog::set_level(spdlog::level::off);
  report_unassigned(log, {.early = {9, 9, 9}, .late = {1, 2, 3}});
  report_unassigned(log, {.out_of_order = {0, 4, 0}});
  report_unassigned(log, {.duplicate = {0, 0, 5}});
  spdlog::set_level(spdlog::level::info);
  r.journal.finish("complete");
  CHECK(events_of(r.path) ==
        std::vector<std::string>{
            "warning run: 1 tags, 2 radar frames, 3 depth frames arrived after their slot was "
            "closed",
            "warning run: 0 tags, 4 radar frames, 0 depth frames arrived out of order",
            "warning run: 0 tags, 0 radar frames, 5 depth frames arrived twice"});
}
