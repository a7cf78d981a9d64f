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

std::unique_ptr<record::RunWriter> open_run(const std::string& path,
                                            const record::RunInfo& info = {}) {
  return a_small_run(0).info(info).open(path);
}

port::SystemLoop loop;  // provides the clock and the worker threads

// Waits until all queued jobs are done.
void wait_for_jobs(Journal& journal) {
  std::promise<void> done;
  journal.put([&](record::RunWriter&) { done.set_value(); });
  done.get_future().wait();
}

void wait_for_lock(const Journal& journal) {
  while (journal.delay_cause() != "another program is writing to the run file")
    std::this_thread::yield();
}

// Keeps a write transaction open, as another program writing to the run file would.
struct Holder : OtherProgram {
  explicit Holder(const std::string& path) : OtherProgram(path) { ask("BEGIN IMMEDIATE"); }
  void let_go() {
    ask("COMMIT");
    db.reset();
  }
};

// Checks that finish() waits no longer than 2 s (instead of 30 s) for another program that locks a
// run file.
void ends_in_time(Journal& journal) {
  const auto start = std::chrono::steady_clock::now();
  check_error(ExitCode::disk, "another program holds a write transaction",
              [&] { journal.finish("complete"); });
  CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(10));
}

}  // namespace

TEST_CASE("the run journal completes all queued jobs in order before it closes the run") {
  const Folder folder;
  Journal journal(open_run(folder / "a.sqlite"), loop);
  for (std::int64_t i = 0; i < 30; ++i) {
    CHECK(journal.put(small_record(i)));
    journal.put([i](record::RunWriter& run) {
      run.put_event(UtcTime(0), Severity::warning, "test", std::to_string(run.records() == i + 1));
    });
  }
  journal.finish("complete");
  CHECK(journal.written() == 30);
  const record::RunReader run(folder / "a.sqlite");
  CHECK(run.info().status == "complete");
  CHECK(run.count() == 30);
  for (const auto& event : run.events()) CHECK(event.text == "1");
}

TEST_CASE("the run journal drops data if the disk is slow and ends the run if the disk stalls") {
  const Folder folder;
  Journal journal(open_run(folder / "a.sqlite"), loop, 2);
  std::promise<void> begun, disk;
  journal.put([&begun, wait = disk.get_future().share()](record::RunWriter&) {
    begun.set_value();
    wait.wait();
  });
  begun.get_future().wait();
  for (std::int64_t i = 0; i < 4; ++i) CHECK(journal.put(small_record(i)) == (i < 2));
  SECTION("records that wait too long for a slow disk are stored without sensor data") {
    disk.set_value();
    journal.finish("complete");
    const record::RunReader run(folder / "a.sqlite");
    REQUIRE(run.count() == 4);
    CHECK(run.read(0).valid == SensorSet::from_bits(7));
    CHECK(run.read(3).valid == SensorSet::from_bits(0));
    CHECK(run.read(3).sync[Sensor::depth].verdict.text() == "not stored: disk too slow");
    CHECK(run.read(3).spd_counts.tags == small_record(3).spd_counts.tags);
  }
  SECTION("a stalled disk ends the run with a disk error") {
    for (std::int64_t i = 4; i < 30; ++i) journal.put(small_record(i));
    CHECK(journal.failed());
    disk.set_value();
    check_error(ExitCode::disk, "disk too slow; its last ", [&] { journal.finish("complete"); });
    CHECK(record::RunReader(folder / "a.sqlite").info().status == "stopped:disk");
  }
}

TEST_CASE(
    "a run file locked by another program is reported, and queued records are written later") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  Journal journal(open_run(path), loop, 2);
  wait_for_jobs(journal);
  Holder holder(path);
  CHECK(journal.put(small_record(0)));
  wait_for_lock(journal);
  for (std::int64_t i = 1; i < 5; ++i) CHECK(journal.put(small_record(i)) == (i < 3));
  SECTION("queued records are written if the lock of the run file is released in time") {
    holder.let_go();
    journal.finish("complete");
    const record::RunReader run(path);
    REQUIRE(run.count() == 5);
    CHECK(run.read(4).sync[Sensor::spd].verdict.text() ==
          "not stored: another program is writing to the run file");
  }
  SECTION("the run ends with an error if the queue is full before the run file is unlocked") {
    for (std::int64_t i = 5; i < 30; ++i) journal.put(small_record(i));
    CHECK(journal.failed());
    holder.let_go();
    check_error(ExitCode::disk,
                "another program is writing to the run file; its last 9 records were not written",
                [&] { journal.finish("complete"); });
    CHECK(record::RunReader(path).count() == 21);
  }
}

TEST_CASE("the run journal stops writing after the first failed job") {
  const Folder folder;
  Journal journal(open_run(folder / "a.sqlite"), loop);
  journal.put(small_record(0));
  std::promise<void> disk;
  journal.put([wait = disk.get_future().share()](record::RunWriter&) {
    wait.wait();
    throw Error(ExitCode::disk, "no space left");
  });
  journal.put(small_record(1));
  disk.set_value();
  while (!journal.failed()) std::this_thread::yield();
  journal.put(small_record(2));
  CHECK(error_of([&] { journal.finish("complete"); }).second ==
        "no space left; its last 2 records were not written");
  const record::RunReader run(folder / "a.sqlite");
  CHECK(run.count() == 1);
  CHECK(run.counters().back().name == "unwritten");
  CHECK(run.counters().back().value == 2);
  CHECK(run.events().back().text == "its last 2 records were not written");
  CHECK(run.info().status == "stopped:disk");
}

// Starts the next file of the run.
static void rotate(Journal& journal, const std::string& path) {
  journal.begin_next([path] { return open_run(path); });
}

TEST_CASE("closing a run waits at most two seconds if another program locks the next run file") {
  const Folder folder;
  Journal journal(open_run(folder / "a.sqlite"), loop);
  rotate(journal, folder / "b.sqlite");
  wait_for_jobs(journal);
  const Holder holder(folder / "b.sqlite");
  journal.put(small_record(1));
  ends_in_time(journal);
}

TEST_CASE(
    "closing a run waits at most two seconds if another program locks the previous run file") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  Journal journal(open_run(path), loop);
  wait_for_jobs(journal);
  Holder holder(path);
  rotate(journal, folder / "b.sqlite");
  while (!fs::exists(folder / "b.sqlite")) std::this_thread::yield();
  SECTION("the next run ends within two seconds and contains a warning about the previous one") {
    const auto start = std::chrono::steady_clock::now();
    CHECK(journal.finish("complete"));
    CHECK(std::chrono::steady_clock::now() - start < std::chrono::seconds(10));
    const auto events = record::RunReader(folder / "b.sqlite").events();
    REQUIRE(events.size() == 1);
    CHECK(events[0].level == "warning");
    CHECK(has(events[0].text, path + ": "));
    CHECK(has(events[0].text, "another program holds a write transaction"));
  }
  SECTION("a label set while the previous file is being closed applies to the next file") {
    wait_for_lock(journal);
    holder.ask("INSERT INTO event (level, utc, text) VALUES ('label', '2026', 'door')");
    journal.put(small_record(1));
    // Writing to the new file does not wait until the old file is closed.
    while (journal.written() == 0) std::this_thread::yield();
    holder.let_go();
    while (!journal.label()) std::this_thread::yield();
    journal.put(small_record(2));
    journal.finish("complete");
    const record::RunReader next(folder / "b.sqlite");
    CHECK(next.read(1).valid == SensorSet::from_bits(7));
    CHECK(next.read(1).label != "door");
    CHECK(next.read(2).label == "door");
    CHECK_THROWS_WITH(record::put_label(path, "late", "me"),
                      Catch::Contains("run is not being recorded"));
  }
}

TEST_CASE("a run keeps all its records if the next file of the rotation cannot be created") {
  const Folder folder;
  const std::string path = folder / "a.sqlite", next = folder / "b.sqlite";
  Journal journal(open_run(path), loop);
  journal.put(small_record(0));
  while (journal.written() == 0) std::this_thread::yield();
  SECTION("the run stops if the next file exists, and that file is not overwritten") {
    write_file(next, "others'");
    rotate(journal, next);
    journal.put(small_record(1));
    const std::string text = check_error(ExitCode::failed, next + ": exists already",
                                         [&] { journal.finish("complete"); });
    CHECK(has(text, "its last 1 records were not written"));
    CHECK(record::RunReader(path).info().status == "stopped:failed");
    CHECK(contents(next) == "others'");
  }
  SECTION("the run stops with a disk error if the disk is full") {
    {
      // An empty run needs 12 pages of 4 KiB, which do not fit on this disk.
      const FullDisk disk(40'000);
      rotate(journal, next);
      while (!journal.failed()) std::this_thread::yield();
    }
    check_error(ExitCode::disk, "", [&] { journal.finish("complete"); });
    CHECK(record::RunReader(path).info().status == "stopped:disk");
    for (const char* beside : {"", "-new", "-new-journal"}) CHECK_FALSE(fs::exists(next + beside));
  }
  CHECK(record::RunReader(path).count() == 1);
}

TEST_CASE("a new label applies to the current slot and all later slots") {
  const Folder folder;
  auto run = open_run(folder / "a.sqlite");
  record::put_label(folder / "a.sqlite", "door", "me");
  Journal journal(std::move(run), loop);
  const auto put = [&](std::int64_t index, UtcTime slot_end) {
    record::FusedRecord r = small_record(index);
    r.label = "before";
    r.slot_utc = slot_end - (r.slot_end - r.slot_start);
    journal.put(r);
  };
  const UtcTime now = system_clock.utc();
  put(0, now - std::chrono::seconds(1));
  put(1, now + std::chrono::seconds(1));
  put(2, now + std::chrono::seconds(2));
  journal.finish("complete");
  const record::RunReader reader(folder / "a.sqlite");
  CHECK(reader.read(0).label == "before");
  CHECK(reader.read(1).label == "door");
  CHECK(reader.read(2).label == "door");
}

TEST_CASE("a depth image that cannot be stored invalidates only the data of the depth camera") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  constexpr std::uint32_t width = record::max_depth_pixels + 1;
  Journal journal(a_small_run(0)
                      .depth({"depth_x", "tangent", "1", width, -0.2, 0.2, 1},
                             {"depth_y", "tangent", "1", 1, 0.1, -0.2, 1})
                      .open(path),
                  loop);
  for (int i = 0; i < 2; ++i) {
    auto record = small_record(i);
    depth_mm(record).assign(width, 1000);
    CHECK(journal.put(std::move(record)));
  }
  journal.finish("complete");
  const record::RunReader run(path);
  REQUIRE(run.count() == 2);
  CHECK(run.read(1).valid == SensorSet::from_bits(3));
  CHECK(run.read(1).sync[Sensor::depth].verdict.text() ==
        "not stored: the image cannot be compressed");
  CHECK(power(run.read(1)) == power(small_record(1)));
}

TEST_CASE("the run log is limited to 100 lines per source in 10 s, and dropped lines are counted") {
  const Folder folder;
  Journal journal(open_run(folder / "a.sqlite"), loop);
  port::VirtualLoop loop;
  RunLog log(loop);
  log.attach(journal);
  spdlog::set_level(spdlog::level::off);
  for (int i = 0; i < 250; ++i) log.put(Severity::warning, "radar", "again");
  log.put(Severity::warning, "spd", "once");
  loop.run_for(std::chrono::seconds(11));
  log.put(Severity::warning, "radar", "later");
  spdlog::set_level(spdlog::level::info);
  journal.finish("complete");
  std::vector<std::string> radar;
  for (const auto& event : record::RunReader(folder / "a.sqlite").events())
    if (event.source == "radar") radar.push_back(event.text);
  REQUIRE(radar.size() == 102);
  CHECK(radar[99] == "again");
  CHECK(radar[100] == "150 log lines dropped (limit 100 in 10 s)");
  CHECK(radar[101] == "later");
}

TEST_CASE("samples that belong to no slot are counted by cause and sensor, and are reported") {
  const Folder folder;
  Journal journal(open_run(folder / "a.sqlite"), loop);
  RunLog log(loop);
  log.attach(journal);
  spdlog::set_level(spdlog::level::off);
  UnassignedSamples unassigned;
  unassigned.late = {1, 2, 3};
  report_unassigned(log, unassigned);
  unassigned.late = {};
  unassigned.out_of_order[Sensor::radar] = 4;
  report_unassigned(log, unassigned);
  unassigned.out_of_order = {};
  unassigned.duplicate[Sensor::depth] = 5;
  report_unassigned(log, unassigned);
  spdlog::set_level(spdlog::level::info);
  journal.finish("complete");
  std::vector<std::string> texts;
  for (const auto& event : record::RunReader(folder / "a.sqlite").events())
    texts.push_back(event.level + " " + event.text);
  CHECK(texts == std::vector<std::string>{
                     "warning 1 tags, 2 radar frames, 3 depth frames arrived after their slot was "
                     "closed",
                     "warning 0 tags, 4 radar frames, 0 depth frames arrived out of order",
                     "warning 0 tags, 0 radar frames, 5 depth frames arrived twice"});
}
