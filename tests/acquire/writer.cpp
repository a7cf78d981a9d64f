// SPDX-License-Identifier: MIT
#include "acquire/run/writer.hpp"

#include <spdlog/spdlog.h>

#include <future>

#include "acquire/record/png.hpp"
#include "acquire/run/run_log.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace testing;

namespace {

std::unique_ptr<record::RunWriter> open_run(const std::string& path) {
  auto run = std::make_unique<record::RunWriter>(path, record::RunInfo{});
  for (const auto& axis : small_axes()) run->put_axis(axis);
  return run;
}

}  // namespace

TEST_CASE("jobs are done in order, and all of them before the run is closed") {
  const Folder folder;
  Writer writer(open_run(folder / "a.sqlite"), port::SystemLoop().make_worker());
  for (std::int64_t i = 0; i < 30; ++i) {
    CHECK(writer.put(small_record(i)));
    writer.put([i](record::RunWriter& run) {
      run.put_event(UtcTime(0), Severity::warning, "test", std::to_string(run.records() == i + 1));
    });
  }
  writer.finish("complete");
  CHECK(writer.written() == 30);
  const record::RunReader run(folder / "a.sqlite");
  CHECK(run.info().status == "complete");
  CHECK(run.count() == 30);
  for (const auto& event : run.events()) CHECK(event.text == "1");
}

TEST_CASE("a slow disk costs data, never a row, a disk that stands still ends the run") {
  const Folder folder;
  Writer writer(open_run(folder / "a.sqlite"), port::SystemLoop().make_worker(), 2);
  std::promise<void> disk;
  writer.put([wait = disk.get_future().share()](record::RunWriter&) { wait.wait(); });
  // Waiting behind the first job, or, before the thread has taken it, with it.
  const bool in_time[] = {writer.put(small_record(0)), writer.put(small_record(1)),
                          writer.put(small_record(2)), writer.put(small_record(3))};
  CHECK(in_time[0]);
  CHECK_FALSE(in_time[2]);
  CHECK_FALSE(in_time[3]);
  SECTION("slow") {
    disk.set_value();
    writer.finish("complete");
    const record::RunReader run(folder / "a.sqlite");
    REQUIRE(run.count() == 4);
    CHECK(run.read(0).valid == SensorSet::from_bits(7));
    CHECK(run.read(3).valid == SensorSet::from_bits(0));
    CHECK(run.read(3).sync[Sensor::depth].verdict == "dropped: the disk does not keep up");
    CHECK(run.read(3).spd_counts.tags == small_record(3).spd_counts.tags);
  }
  SECTION("stands still") {
    for (std::int64_t i = 4; i < 30; ++i) writer.put(small_record(i));
    CHECK(writer.failed());
    disk.set_value();
    const auto [code, text] = error_of([&] { writer.finish("complete"); });
    CHECK(code == ExitCode::disk);
    CHECK(has(text, "the disk does not keep up"));
    CHECK(record::RunReader(folder / "a.sqlite").info().status == "stopped:disk");
  }
}

TEST_CASE("the first failed job ends the writing") {
  const Folder folder;
  Writer writer(open_run(folder / "a.sqlite"), port::SystemLoop().make_worker());
  writer.put(small_record(0));
  std::promise<void> disk;
  writer.put([wait = disk.get_future().share()](record::RunWriter&) {
    wait.wait();
    throw Error(ExitCode::disk, "no space left");
  });
  writer.put(small_record(1));
  disk.set_value();
  while (!writer.failed()) std::this_thread::yield();
  writer.put(small_record(2));
  CHECK(error_of([&] { writer.finish("complete"); }).second == "no space left");
  const record::RunReader run(folder / "a.sqlite");
  CHECK(run.count() == 1);
  CHECK(run.info().status == "stopped:disk");
}

TEST_CASE("not every failure is the disk's") {
  const Folder folder;
  Writer writer(open_run(folder / "a.sqlite"), port::SystemLoop().make_worker());
  writer.put([](record::RunWriter&) { throw Error(ExitCode::failed, "not a number"); });
  CHECK(error_of([&] { writer.finish("complete"); }) ==
        std::pair(ExitCode::failed, std::string("not a number")));
  CHECK(record::RunReader(folder / "a.sqlite").info().status == "stopped:failed");
}

TEST_CASE("a label begins with the slot that is running when it is given") {
  const Folder folder;
  auto run = open_run(folder / "a.sqlite");
  record::put_label(folder / "a.sqlite", "door", "me");
  Writer writer(std::move(run), port::SystemLoop().make_worker());
  const auto put = [&](std::int64_t index, UtcTime slot_end) {
    record::FusedRecord r = small_record(index);
    r.label = "before";
    r.slot_utc = slot_end - (r.slot_end - r.slot_start);
    writer.put(r);
  };
  const UtcTime now = system_clock.utc();
  put(0, now - std::chrono::seconds(1));
  put(1, now + std::chrono::seconds(1));
  put(2, now + std::chrono::seconds(2));
  writer.finish("complete");
  const record::RunReader reader(folder / "a.sqlite");
  CHECK(reader.read(0).label == "before");
  CHECK(reader.read(1).label == "door");
  CHECK(reader.read(2).label == "door");
}

TEST_CASE("without finish a run looks crashed, with all that was put") {
  const Folder folder;
  {
    Writer writer(open_run(folder / "a.sqlite"), port::SystemLoop().make_worker());
    writer.put(small_record(0));
  }
  const record::RunReader run(folder / "a.sqlite");
  CHECK(run.count() == 1);
  CHECK(run.info().status == "crashed");
}

TEST_CASE("a depth image that cannot be encoded costs its sensor, not the run") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  auto file = std::make_unique<record::RunWriter>(path, record::RunInfo{});
  constexpr std::uint32_t width = record::max_png_pixels + 1;
  for (auto axis : small_axes()) {
    if (axis.name == "depth_x") axis.count = width;
    if (axis.name == "depth_y") axis.count = 1;
    file->put_axis(axis);
  }
  Writer writer(std::move(file), port::SystemLoop().make_worker());
  for (int i = 0; i < 2; ++i) {
    auto record = small_record(i);
    record.depth_mm.assign(width, 1000);
    CHECK(writer.put(std::move(record)));
  }
  writer.finish("complete");
  const record::RunReader run(path);
  REQUIRE(run.count() == 2);
  CHECK(run.read(1).valid == SensorSet::from_bits(3));
  CHECK(run.read(1).sync[Sensor::depth].verdict == "cannot be encoded as PNG");
  CHECK(run.read(1).radar == small_record(1).radar);
}

TEST_CASE("a source has 100 lines in 10 s, and the next one says how many there were more") {
  const Folder folder;
  Writer writer(open_run(folder / "a.sqlite"), port::SystemLoop().make_worker());
  port::VirtualLoop loop;
  RunLog log(loop);
  log.attach(writer);
  spdlog::set_level(spdlog::level::off);
  for (int i = 0; i < 250; ++i) log.put(Severity::warning, "radar", "again");
  log.put(Severity::warning, "spd", "once");
  loop.run_for(std::chrono::seconds(11));
  log.put(Severity::warning, "radar", "later");
  spdlog::set_level(spdlog::level::info);
  writer.finish("complete");
  std::vector<std::string> radar;
  for (const auto& event : record::RunReader(folder / "a.sqlite").events())
    if (event.source == "radar") radar.push_back(event.text);
  REQUIRE(radar.size() == 102);
  CHECK(radar[99] == "again");
  CHECK(radar[100] == "150 lines were left out");
  CHECK(radar[101] == "later");
}
