// SPDX-License-Identifier: MIT
#include "acquire/record/export.hpp"

#include <sqlite3.h>

#include <cmath>
#include <functional>
#include <sstream>

#include "acquire/record/h5_out.hpp"
#include "h5_reader.hpp"
#include "testing.hpp"

using namespace echofuse;
using namespace echofuse::record;
using namespace testing;

TEST_CASE("what is exported to HDF5 is the run") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  {
    RunWriter run(path, {});
    for (const auto& axis : small_axes()) run.put_axis(axis);
    run.put_device({Sensor::spd, "bridge:tcp://h:1", "TT", "42", "1.0", {}});
    for (std::int64_t i = 0; i < 20; ++i) {
      auto r = small_record(i);
      if (i == 7) r.valid = SensorSet::from_bits(0);
      if (i == 9) r.radar[1] = std::nanf("");
      run.append(r);
    }
    run.close("complete");
  }
  const RunReader run(path);
  CHECK(export_h5({folder / "a.sqlite"}, folder / "a.h5") == 1);

  const H5Reader in(folder / "a.h5");
  const std::string data = "/entry/data/";
  CHECK(in.shape(data + "spd") == H5Shape{20, 8});
  CHECK(in.shape(data + "radar") == H5Shape{20, 4});
  CHECK(in.shape(data + "depth") == H5Shape{20, 2, 3});
  const auto spd = in.read<std::uint32_t>(data + "spd");
  const auto radar = in.read<float>(data + "radar");
  const auto depth = in.read<float>(data + "depth");
  const auto valid = in.read<std::uint8_t>(data + "valid");
  const auto index = in.read<std::int64_t>(data + "index");
  const auto start = in.read<std::int64_t>(data + "slot_start");
  const auto label = in.read_texts(data + "label");
  for (std::size_t i = 0; i < 20; ++i) {
    const auto r = small_record(static_cast<std::int64_t>(i));
    REQUIRE(index[i] == r.index);
    const bool bad = i == 7 || i == 9;
    REQUIRE(valid[i] == (bad ? 0 : 7));
    for (std::size_t b = 0; b < 8; ++b) REQUIRE(spd[i * 8 + b] == (bad ? 0 : r.spd[b]));
    for (std::size_t p = 0; p < 6; ++p)
      if (bad || r.depth_mm[p] == 0)
        REQUIRE(std::isnan(depth[i * 6 + p]));
      else
        REQUIRE(depth[i * 6 + p] == r.depth_mm[p]);
    if (bad)
      REQUIRE(std::isnan(radar[i * 4 + 3]));
    else
      REQUIRE(radar[i * 4 + 3] == r.radar[3]);
    if (i != 9) REQUIRE(label[i] == r.label);
    if (i != 9) REQUIRE(start[i] == r.slot_start.count());
  }
  CHECK(in.read_texts("/entry/sync/radar/verdict")[9] ==
        "unreadable: radar bin 1 is not a finite number");
  CHECK(in.read<double>(data + "spd_time")[3] == 13343 + 300);
  CHECK(in.text_of(data + "spd_time", "units") == "ps");
  CHECK(in.text_of(data + "depth", "units") == "mm");
  CHECK(in.text_of("/entry", "NX_class") == "NXentry");
  CHECK(in.read_text("/entry/entry_identifier") == run.info().uuid);
  CHECK(in.read_text("/entry/instrument/spd/model") == "TT");
}

namespace {

// A run with rows in every table, two of them where the second has NULLs.
void write_full_run(const std::string& path) {
  RunInfo info;
  info.window_s = 0.2;
  info.operator_name = "Ada";
  info.meta = {{"gel", "blue"}, {"laser", "5 mW, \xc2\xb5"}};
  RunWriter run(path, info);
  for (const auto& axis : small_axes()) run.put_axis(axis);
  run.put_axis({"array", "covariance", "m", 1, 0, 0.5, 2});
  run.put_antennas({{0, 0, 1, 0}, {1, 0, 1.25, 0.5}});
  run.put_device({Sensor::spd, "bridge:tcp://h:1", "TT", "42", "1.0", {}});
  run.put_calibration({Sensor::radar, "2026-01-01", "plate", 2, 0.0125, 0.001});
  run.put_policy(Sensor::spd, "required");
  run.put_anchor(HostTime(5), UtcTime(7));
  run.put_late(0, {{1, {3, 2, 1}}});
  const Counted tags{"spd", "tags", 12'345'678'901, 0};
  run.put_counters({&tags, 1});
  run.put_event(UtcTime(0), Severity::warning, "radar", "no frames");
  put_label(path, "letter:B", "me");
  put_note(path, "door open", "me");
  for (std::int64_t i = 0; i < 3; ++i) {
    FusedRecord r = small_record(i);
    r.spd_counts.overflows = 2;
    if (i > 0) r.array.assign(values_of_bin(2), 1), r.array_frames = 4;
    r.speckle = record::Speckle{0.4, 0.2};
    if (i > 0) r.radar_stats = RadarStats{1, 2, 3, 4, 5, 6};
    if (i == 1) r.radar_temperature = RadarTemperature{0, 9, {-1, 2, 3, 4, 5, 6, 7, 8, 9, 10}};
    if (i == 2) r.missing = SensorSet::from_bits(1), r.valid = SensorSet::from_bits(6);
    if (i > 0) r.clocks[Sensor::radar] = ClockState{0.5, -3.25, 1e-6, 40};
    if (i == 1) r.statistics.radar_last = 77;
    if (i == 1) r.signal = {0.01, 900, 3.5, 22.0, 3.25, 0.5};
    run.append(r);
  }
  run.close("complete");
}

using Query = std::function<void(sqlite3_stmt*)>;
void each_row(sqlite3* db, const std::string& sql, const Query& visit) {
  sqlite3_stmt* s = nullptr;
  REQUIRE(sqlite3_prepare_v2(db, sql.c_str(), -1, &s, nullptr) == SQLITE_OK);
  while (sqlite3_step(s) == SQLITE_ROW) visit(s);
  sqlite3_finalize(s);
}

std::string text_of(sqlite3_stmt* s, int column) {
  const auto* text = sqlite3_column_text(s, column);
  return text ? reinterpret_cast<const char*>(text) : "";
}

// The exported values of one column against the database's own.
void check_column(sqlite3* db, const H5Reader& in, const std::string& table,
                  const std::string& column, const std::string& type) {
  const std::string name = "/entry/tables/" + table + "/" + column;
  CAPTURE(name);
  REQUIRE(in.has(name));
  std::size_t row = 0;
  const auto whole = type == "INTEGER" ? in.read<std::int64_t>(name) : std::vector<std::int64_t>{};
  const auto real = type == "REAL" ? in.read<double>(name) : std::vector<double>{};
  const auto texts = type == "TEXT" ? in.read_texts(name) : std::vector<std::string>{};
  if (type != "TEXT") CHECK_FALSE(in.text_of(name, "units").empty());
  each_row(db, "SELECT " + column + " FROM " + table + " ORDER BY rowid", [&](sqlite3_stmt* s) {
    const bool null = sqlite3_column_type(s, 0) == SQLITE_NULL;
    if (type == "INTEGER")
      CHECK(whole.at(row) == (null ? null_integer : sqlite3_column_int64(s, 0)));
    else if (type == "REAL" && null)
      CHECK(std::isnan(real.at(row)));
    else if (type == "REAL")
      CHECK(real.at(row) == sqlite3_column_double(s, 0));
    else
      CHECK(texts.at(row) == text_of(s, 0));
    ++row;
  });
  CHECK(row > 0);
  CHECK(row == whole.size() + real.size() + texts.size());
}

}  // namespace

TEST_CASE("every table of a run is in its export, with units") {
  const Folder folder;
  write_full_run(folder / "a.sqlite");
  CHECK(export_h5({folder / "a.sqlite"}, folder / "a.h5") == 0);
  const H5Reader in(folder / "a.h5");
  sqlite3* db = nullptr;
  REQUIRE(sqlite3_open((folder / "a.sqlite").c_str(), &db) == SQLITE_OK);
  std::vector<std::string> tables;
  each_row(db, "SELECT name FROM sqlite_schema WHERE type = 'table'",
           [&](sqlite3_stmt* s) { tables.push_back(text_of(s, 0)); });
  CHECK(tables.size() == 10);
  for (const auto& table : tables)
    each_row(db, "PRAGMA table_info(" + table + ")", [&](sqlite3_stmt* s) {
      if (text_of(s, 2) != "BLOB") check_column(db, in, table, text_of(s, 1), text_of(s, 2));
    });
  sqlite3_close(db);
  const std::string all = "/entry/tables/";
  CHECK(in.read_texts(all + "event/text").back() == "door open");
  CHECK(has(in.read_texts(all + "run/meta").at(0), R"("gel":"blue")"));
  CHECK(in.text_of(all + "record/closed_late_s", "units") == "s");
  CHECK(in.text_of(all + "record/speckle_over_150_ms", "units") == "1");
  CHECK(in.text_of(all + "record/radar_snr_db", "units") == "dB");
  CHECK(in.text_of(all + "record/slot_utc_ns", "units") ==
        "nanoseconds since 1970-01-01T00:00:00Z");
  CHECK(in.text_of(all + "record/radar_rx0_c", "units") == "degC");
  CHECK(in.text_of(all + "record/radar_clock_drift_ppm", "units") == "1e-6");
  CHECK(in.text_of(all + "record/radar_transmit_us", "units") == "us");
}

TEST_CASE("an export never overwrites, and leaves nothing behind if it fails") {
  const Folder folder;
  write_run(folder / "a.sqlite", 2);
  const RunReader run(folder / "a.sqlite");
  write_file(folder / "a.h5", "precious");
  CHECK(has(error_of([&] { export_h5({folder / "a.sqlite"}, folder / "a.h5"); }).second,
            "exists already"));
  CHECK(fs::file_size(folder / "a.h5") == 8);
  const auto stop = [&](std::int64_t, std::int64_t) {
    CHECK_FALSE(fs::exists(folder / "b.h5"));  // as a killed process leaves it
    throw Error(ExitCode::failed, "stop");
  };
  CHECK(error_of([&] { export_h5({folder / "a.sqlite"}, folder / "b.h5", stop); }).second ==
        "stop");
  CHECK_FALSE(fs::exists(folder / "b.h5"));
}

TEST_CASE("a run without records or axes can be exported") {
  const Folder folder;
  RunWriter(folder / "a.sqlite", {}).close("complete");
  CHECK(export_h5({folder / "a.sqlite"}, folder / "a.h5") == 0);
  CHECK(H5Reader(folder / "a.h5").shape("/entry/data/index") == H5Shape{0});
}

TEST_CASE("one record as CSV") {
  const Folder folder;
  write_run(folder / "a.sqlite", 3);
  const RunReader run(folder / "a.sqlite");
  export_csv(run, 2, folder / "a.csv");
  std::ifstream in(folder / "a.csv");
  std::stringstream text;
  text << in.rdbuf();
  CHECK(has(text.str(), "\nsensor,x,y,value\nspd,13343,,200\nspd,13443,,201\n"));
  CHECK(has(text.str(), "\nradar,1.5,,5.25\n"));
  CHECK(has(text.str(), "\ndepth,0.2,-0.1,17\n"));
  CHECK(has(error_of([&] { export_csv(run, 3, folder / "b.csv"); }).second, "no record 3"));
}

TEST_CASE("HDF5 errors name the file and the dataset, and print nothing else") {
  const Folder folder;
  const std::string path = folder / "m.h5";
  {
    H5Out out(path);
    out.write<double>("layer/0/weights", {1, 2, 3, 4, 5, 6}, {2, 3});
    out.set("layer/0/weights", "loss", 0.5);
    out.set("/", "epochs", std::int64_t{7});
    out.write_text("name", "µ-Netz");
    CHECK(has(error_of([&] {
                out.write<float>("a", {1, 2, 3}, {2});
              }).second,
              path + ": a: shape and number of values differ"));
    out.allocate<float>("rows", {3, 2});
    const std::vector<float> row{1, 2, 3};
    const auto write = [&](std::size_t at, std::size_t values) {
      return error_of([&] { out.write_row<float>("rows", at, std::span(row).first(values)); });
    };
    CHECK(has(write(3, 2).second, "the row does not fit"));
    CHECK(has(write(2, 3).second, "the row does not fit"));
    out.write_row<float>("rows", 2, std::span(row).first(2));
    CHECK(has(error_of([&] { out.link("b", "layer/9"); }).second, path + ": b: cannot link ("));
    CHECK(has(error_of([&] { out.put_scale("layer/9", 0, "rows"); }).second,
              path + ": layer/9: no such dataset"));
    CHECK(out.has("layer/0/weights"));
    CHECK_FALSE(out.has("layer/1/weights"));
    out.close();
  }
  CHECK(has(error_of([&] { H5Out out(path); }).second, path + ": exists already"));
  const H5Reader in(path);
  CHECK(in.read<float>("layer/0/weights") == std::vector<float>{1, 2, 3, 4, 5, 6});
  const auto rows = in.read<float>("rows");
  CHECK(std::all_of(rows.begin(), rows.begin() + 4, [](float v) { return std::isnan(v); }));
  CHECK(std::vector(rows.begin() + 4, rows.end()) == std::vector<float>{1, 2});
  CHECK(in.number_of("layer/0/weights", "loss") == 0.5);
  CHECK(in.number_of("/", "epochs") == 7);
  CHECK(in.read_text("name") == "µ-Netz");
}
