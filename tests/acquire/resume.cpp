// SPDX-License-Identifier: MIT
#include "acquire/run/resume.hpp"

#include <sqlite3.h>

#include "acquire/commands/commands.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::acquire;
using namespace testing;

namespace {

// Rows as the sqlite3 shell shows them, a line each.
std::string query(const std::string& path, const char* statement) {
  sqlite3* db = nullptr;
  REQUIRE(sqlite3_open(path.c_str(), &db) == SQLITE_OK);
  std::string rows;
  const auto add = [](void* all, int count, char** values, char**) {
    for (int i = 0; i < count; ++i)
      static_cast<std::string*>(all)->append(values[i]).append(i + 1 < count ? "|" : "\n");
    return 0;
  };
  REQUIRE(sqlite3_exec(db, statement, add, &rows, nullptr) == SQLITE_OK);
  sqlite3_close(db);
  return rows;
}

}  // namespace

TEST_CASE("a run is resumed with its own configuration only") {
  const Folder folder;
  const std::string path = folder / "lab.toml";
  write_file(path,
             "[tdc]\naddress = \"bridge:tcp://127.0.0.1:9\"\n[depth]\naddress = \"openni:\"\n");
  const Config first = load_config(path);
  record::RunInfo begun;
  begun.config_resolved = first.resolved;
  begun.radar_cfg = first.radar.cfg_text;
  const auto verdict = [&](const std::vector<std::string>& set) {
    return error_of([&] { refuse_other_config(begun, {}, load_config(path, set)); });
  };
  CHECK(verdict({}).first == ExitCode::ok);
  CHECK(verdict({"run.label=x", "run.operator=y", "run.connect_timeout_s=3",
                 "tdc.address=bridge:tcp://10.0.0.1:9"})
            .first == ExitCode::ok);
  const auto [code, text] = verdict({"tdc.bins=7", "run.window_s=1"});
  CHECK(code == ExitCode::config);
  CHECK(has(text, "\nrun.window_s was 3.0, now 1.0"));
  CHECK(has(text, "\ntdc.bins was "));
  CHECK(has(text, ", now 7"));
  CHECK(has(verdict({"depth.address="}).second, "depth.address was a device, now none"));
  begun.radar_cfg = "sensorStart\n";
  CHECK(has(verdict({}).second, "radar.cfg has another text"));
}

TEST_CASE("no run begins so late that its times do not fit into the file") {
  using std::chrono::years;
  CHECK(error_of([] { refuse_late_clock(UtcTime::max() - years(10)); }).first == ExitCode::ok);
  const auto [code, text] = error_of([] { refuse_late_clock(UtcTime::max() - years(2)); });
  CHECK(code == ExitCode::failed);
  CHECK(has(text, "the machine's clock is at 2260-"));
  CHECK(has(text, "set the clock"));
}

TEST_CASE("a run is resumed with its own calibration only, whatever its file is called") {
  const Folder folder;
  const std::string path = folder / "lab.toml";
  write_file(path, "[depth]\naddress = \"openni:\"\n");
  Calibration c;
  c.entries = {{Sensor::spd, "2026-11-21T10:00:00Z", "m", 1, 0.0656, 1e-5}};
  write_calibration(folder / "a.toml", c);
  write_calibration(folder / "b.toml", c);
  const std::vector<std::string> first{"run.calibration=a.toml"};
  record::RunInfo info;
  info.config_resolved = load_config(path, first).resolved;
  record::RunWriter writer(folder / "run.sqlite", info);
  for (const auto& entry : c.entries) writer.put_calibration(entry);
  writer.close("complete");
  const auto verdict = [&](const std::vector<std::string>& set) {
    return error_of(
        [&] { refuse_resuming(record::RunReader(folder / "run.sqlite"), load_config(path, set)); });
  };
  CHECK(verdict(first).second == "");
  CHECK(verdict({"run.calibration=b.toml"}).second == "");
  c.entries[0].date_utc = "2026-11-22T10:00:00Z";
  c.entries[0].offset_m = 0.0666;
  c.entries.push_back({Sensor::radar, "2026-11-22T10:00:00Z", "m", 1, -0.01, 2e-4});
  write_calibration(folder / "a.toml", c);
  const auto [code, text] = verdict(first);
  CHECK(code == ExitCode::config);
  CHECK(has(text,
            "\nrun.calibration: the offset of spd was +65.600 mm +- 0.010 mm of "
            "2026-11-21T10:00:00Z, now +66.600 mm +- 0.010 mm of 2026-11-22T10:00:00Z"));
  CHECK(has(text, "\nrun.calibration: the offset of radar was none, now -10.000 mm +- "));
  CHECK(has(verdict({}).second, "2026-11-21T10:00:00Z, now none"));
}

TEST_CASE("a device with another axis does not continue a run") {
  DeviceInfo device;
  device.sensor = Sensor::radar;
  device.axes = {small_axes()[1]};
  CHECK(error_of([&] { refuse_other_axes(small_axes(), device); }).first == ExitCode::ok);
  device.axes[0].step = 0.25;
  CHECK(has(error_of([&] { refuse_other_axes(small_axes(), device); }).second,
            "radar: its axis radar is not the one that the run was begun with"));
}

TEST_CASE("each part of a resumed run has its own counters") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto sql = [&](const char* statement) { return query(path, statement); };
  const std::vector<record::Counted> counted{{"spd", "tags", 7}, {"radar", "late", 2}};
  const auto texts = [&] {
    std::string all;
    for (const auto& c : record::RunReader(path).counters())
      all += std::to_string(c.part) + ' ' + c.source + ' ' + c.name + ' ' +
             std::to_string(c.value) + '\n';
    return all;
  };
  write_run(path, 3);
  const std::string first = "0 spd tags 7\n0 radar late 2\n";
  sql("INSERT INTO counter VALUES ('spd', 'tags', 7, 0), ('radar', 'late', 2, 0)");
  CHECK(texts() == first);
  for (const char* part : {"1", "2"}) {
    record::RunWriter again(path);
    again.append(small_record(again.next_index()));
    again.put_counters(counted);
    again.close("complete");
    CHECK(has(texts(), std::string(part) + " spd tags 7\n"));
  }
  CHECK(texts() == first + "1 spd tags 7\n1 radar late 2\n2 spd tags 7\n2 radar late 2\n");
  CHECK(sql("SELECT key, value ->> 'first_idx' FROM run, json_each(part)") == "0|0\n1|3\n2|4\n");
  CHECK(has(describe_run({path}, false), "counted   part 2 radar: late 2\n"));
}

TEST_CASE("the counters of a part come all or not at all") {
  const Folder folder;
  write_run(folder / "a.sqlite", 1);
  record::RunWriter again(folder / "a.sqlite");
  query(folder / "a.sqlite", "CREATE UNIQUE INDEX once ON counter (name)");
  const std::vector<record::Counted> counted{{"spd", "a", 1}, {"radar", "a", 2}};
  CHECK(has(error_of([&] { again.put_counters(counted); }).second, "UNIQUE"));
  query(folder / "a.sqlite", "DROP INDEX once");
  CHECK(record::RunReader(folder / "a.sqlite").counters().empty());
}

TEST_CASE("a run goes on with its last label, also one that a mark gave it") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  const auto last = [&] { return reopen_run(path, ManualClock()).label.value_or("none"); };
  write_run(path, 0);
  CHECK(last() == "none");
  {
    record::RunWriter again(path);
    again.append(small_record(0));
    again.close("complete");
  }
  CHECK(last() == "person");
  {
    record::RunWriter again(path);
    record::put_label(path, "door", "me");  // after the last record
    again.close("complete");
  }
  CHECK(last() == "door");
  {
    record::RunWriter again(path);
    auto later = small_record(1);
    later.slot_utc = system_clock.utc() + std::chrono::seconds(1);
    later.label = "chair";
    again.append(later);
    again.close("complete");
  }
  CHECK(last() == "chair");
}
