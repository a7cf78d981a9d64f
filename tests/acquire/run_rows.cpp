// SPDX-License-Identifier: MIT
// Tests that random runs, with and without optional values, are read back as written.

#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/rows.hpp"
#include "testing.hpp"

using namespace echofuse::record;

namespace {

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  bool coin() { return engine_() % 2 == 0; }
  template <class T>
  T whole(T most = std::numeric_limits<T>::max()) {
    const std::int64_t limit = std::in_range<std::int64_t>(most)
                                   ? static_cast<std::int64_t>(most)
                                   : std::numeric_limits<std::int64_t>::max();
    if (engine_() % 8 == 0) return static_cast<T>(limit);
    return static_cast<T>(std::uniform_int_distribution<std::int64_t>(0, limit)(engine_));
  }
  double real() { return std::normal_distribution<>(0, 100)(engine_); }
  std::string text() {
    const char* texts[] = {
        "", "ok", "weak: 98 clicks", "\xc3\xa9 \xe2\x82\xac", "'; DROP TABLE record", "\n\x01"};
    return texts[engine_() % std::size(texts)];
  }
  template <class T>
  std::vector<T> values(std::size_t count) {
    std::vector<T> out(count);
    for (T& v : out) v = static_cast<T>(engine_() % 65536);
    return out;
  }

 private:
  std::mt19937 engine_;
};

constexpr std::size_t antennas = 3;

std::vector<Axis> axes_of(Random& random) {
  const auto count = [&] { return 1 + random.whole<std::uint32_t>(8); };
  const Zones zones{{-0.2, 0.1, 0.2, 1100}, {0, 0.1, 0.2, 1150.5}, {}};
  return {{"spd", "counts", "ps", count(), 13343, 100, 1, random.coin() ? zones : single_pixel()},
          {"radar", "power", "m", count(), 0, 0.5, 1},
          {"array", "covariance", "m", count(), 0, 0.5, antennas},
          {"depth_x", "tangent", "1", count(), -0.2, 0.2, 1},
          {"depth_y", "tangent", "1", count(), 0.1, -0.2, 1}};
}

FusedRecord record_of(std::int64_t index, const std::vector<Axis>& axes, Random& random) {
  FusedRecord r;
  r.index = index;
  r.slot_start = HostTime(random.whole<std::int64_t>(1'000'000'000'000));
  r.slot_end = r.slot_start + HostTime(random.whole<std::int64_t>(3'000'000'000));
  r.slot_utc = UtcTime(random.whole<std::int64_t>(2'000'000'000'000'000'000));
  r.valid = SensorSet::from_bits(random.whole<std::uint32_t>(7));
  r.missing = SensorSet::from_bits(random.whole<std::uint32_t>(7));
  r.label = random.text();
  const auto number = [&] { return random.whole<std::uint64_t>(); };
  TagCounts& c = r.spd_counts;
  for (std::uint64_t* n :
       {&c.tags, &c.starts, &c.in_range, &c.out_of_range, &c.without_start, &c.other, &c.missed,
        &c.overflows, &c.errors, &c.bad_tags, &c.backwards, &c.removed})
    *n = number();
  for (const Sensor s : all_sensors) {
    const auto kind = static_cast<VerdictKind>(number() % verdict_table().size());
    r.sync[s] = {random.real(), random.real(), number(), number(), {kind, random.text()}};
    if (random.coin())
      r.clocks[s] = ClockState{random.real(), random.real(), random.real(), number()};
  }
  r.statistics = {number(), number(), {}, {}, random.real()};
  for (auto* last : {&r.statistics.radar_last, &r.statistics.depth_last})
    if (random.coin()) *last = random.whole<std::uint32_t>();
  if (random.coin()) r.signal.clicks_per_pulse = std::abs(random.real());
  for (auto* v : {&r.signal.spd_clicks, &r.signal.spd_peak_m, &r.signal.radar_snr_db,
                  &r.signal.radar_peak_m, &r.signal.depth_share})
    if (random.coin()) *v = random.real();
  if (random.coin()) {
    RadarStats& stats = r.radar_stats.emplace();
    for (auto* v : {&stats.inter_frame_processing_us, &stats.transmit_us,
                    &stats.inter_frame_margin_us, &stats.inter_chirp_margin_us,
                    &stats.active_frame_load_percent, &stats.inter_frame_load_percent})
      *v = random.whole<std::uint32_t>();
  }
  if (random.coin()) {
    r.radar_temperature = RadarTemperature{random.coin(), random.whole<std::uint32_t>(), {}};
    for (auto& celsius : r.radar_temperature->celsius)
      celsius = static_cast<std::int16_t>(random.real());
  }
  r.array_frames = random.whole<std::uint64_t>(100);
  if (r.has(Sensor::spd)) counts(r) = random.values<std::uint32_t>(axes[0].values());
  if (r.has(Sensor::radar)) power(r) = random.values<float>(axes[1].count);
  if (r.has(Sensor::radar) && random.coin()) {
    antenna_data(r).assign(axes[2].count * values_of_bin(antennas), 0);
    // The values are integers, because packing stores integers without rounding.
    for (std::size_t bin = 0; bin < axes[2].count; ++bin)
      std::fill_n(antenna_data(r).begin() +
                      static_cast<std::ptrdiff_t>(bin * values_of_bin(antennas) + 2 * antennas),
                  antennas, static_cast<float>(random.whole<int>(100)));
  }
  if (r.has(Sensor::depth))
    depth_mm(r) = random.values<std::uint16_t>(std::size_t{axes[3].count} * axes[4].count);
  return r;
}

// Returns the name and the SQLite value of every column. Columns that are added to the table later
// are thus compared as well.
std::vector<std::string> values_of(const FusedRecord& r) {
  const std::string name = ":memory:";
  const DatabaseHandle db = open_database(name, "cannot open", SQLITE_OPEN_MEMORY);
  execute(db.get(), name, table_of<FusedRecord>().create().c_str(), "cannot create");
  insert(db.get(), name, r);
  std::vector<std::string> out;
  sqlite3_exec(
      db.get(), table_of<FusedRecord>().select().c_str(),
      [](void* all, int count, char** values, char** names) {
        for (int i = 0; i < count; ++i)
          static_cast<std::vector<std::string>*>(all)->push_back(std::string(names[i]) + " " +
                                                                 (values[i] ? values[i] : "NULL"));
        return 0;
      },
      &out, nullptr);
  return out;
}

std::vector<FusedRecord> write_random(const std::string& path, unsigned seed) {
  Random random(seed);
  const auto axes = axes_of(random);
  RunWriter run(path, {});
  for (const Axis& axis : axes) run.put_axis(axis);
  std::vector<FusedRecord> records;
  for (std::int64_t i = 0; i < 12; ++i) {
    records.push_back(record_of(i, axes, random));
    run.append(records.back());
  }
  run.close("complete");
  return records;
}

}  // namespace

void echofuse::test::check_same(const FusedRecord& read, const FusedRecord& wrote) {
  CHECK(values_of(read) == values_of(wrote));
  CHECK(read.spd_counts == wrote.spd_counts);
  CHECK(read.signal == wrote.signal);
  const bool measured = wrote.radar_temperature && wrote.radar_temperature->invalid == 0;
  CHECK(read.radar_temperature.has_value() == measured);
  CHECK(difference(read, wrote) == "");
  REQUIRE(antenna_data(read).size() == antenna_data(wrote).size());
  for (std::size_t i = 0; i < antenna_data(read).size(); ++i)
    CHECK(antenna_data(read)[i] == Approx(antenna_data(wrote)[i]).margin(1e-2));
}

TEST_CASE("a record with any combination of optional values is read back as written") {
  const Folder folder;
  for (unsigned seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    const std::string path = folder / std::to_string(seed);
    const std::vector<FusedRecord> wrote = write_random(path, seed);
    const RunReader run(path);
    Random again(seed);
    CHECK(std::ranges::equal(run.axes(), axes_of(again), same_axis));
    const std::vector<FusedRecord> outlines = run.outlines(0);
    REQUIRE(outlines.size() == wrote.size());
    for (std::size_t i = 0; i < wrote.size(); ++i) {
      check_same(run.read(static_cast<std::int64_t>(i)), wrote[i]);
      CHECK(values_of(outlines[i]) == values_of(wrote[i]));
    }
  }
}

TEST_CASE("the metadata of a run are read back as written") {
  const Folder folder;
  const std::string path = folder / "a";
  RunInfo info;
  int number = 0;
  constexpr std::string RunInfo::*texts[] = {&RunInfo::uuid,          &RunInfo::started_utc,
                                             &RunInfo::config_text,   &RunInfo::config_resolved,
                                             &RunInfo::radar_cfg,     &RunInfo::version,
                                             &RunInfo::operator_name, &RunInfo::notes,
                                             &RunInfo::host};
  for (const auto text : texts) info.*text = "\xc3\xa9 " + std::to_string(++number);
  info.window_s = 0.25;
  info.meta = {{"z", "1"}, {"a", "\"\n\xc3\xa9"}, {"", ""}};
  const std::vector<CalibrationEntry> calibrations{{Sensor::radar, "2026", "plate", 1, 2, 3}};
  const Antennas places{{0, 1, 2, 3}, {4, 5, 6, 7}};
  {
    RunWriter run(path, info);
    run.put_policy(Sensor::depth, "optional");
    run.put_policy(Sensor::spd, "optional");
    run.put_policy(Sensor::spd, "required");
    run.put_device({Sensor::spd, "address", "model", "serial", "firmware", {}});
    run.put_device({Sensor::spd, "address", "model", "serial", "later", {}});
    run.put_device({Sensor::radar, "", "", "", "", {}});
    run.put_calibration(calibrations[0]);
    run.put_antennas({});
    run.put_antennas(places);
    run.put_anchor(HostTime(3), UtcTime(4));
    run.put_late({{2, {1, 2, 3}}, {3, {4, 5, 6}}});
    run.put_late({{3, {1, 1, 1}}});
    run.put_event(UtcTime(0), Severity::error, "radar", "x");
    const CounterRow counted{"spd", "tags", 9};
    run.put_counters({&counted, 1});
    run.close("complete");
  }
  const RunReader run(path);
  const RunInfo read = run.info();
  CHECK(read.meta == info.meta);
  CHECK(read.window_s == 0.25);
  for (const auto text : texts) CHECK(read.*text == info.*text);
  CHECK(run.policies() ==
        std::map<std::string, std::string>{{"spd", "required"}, {"depth", "optional"}});
  REQUIRE(run.devices().size() == 3);
  CHECK(run.devices()[1].firmware == "later");
  CHECK(run.calibrations() == calibrations);
  CHECK(run.antennas() == places);
  CHECK(run.anchors().at(0).utc == UtcTime(4));
  CHECK(run.late() == PerSensor<std::int64_t>{6, 8, 10});
  CHECK(run.events().at(0).level == "error");
  CHECK(run.counters().at(0).value == 9);
}

TEST_CASE("the Python package contains the SQL definitions of the tables") {
  std::string expected;
  for (const auto& [name, sql] : table_definitions()) expected += sql + "\n";
  CHECK(contents(source_dir + "/recon/python/echofuse/runs/schema.sql") == expected);
}

TEST_CASE("a zone is refused if its width is zero or its time-zero offset exceeds one second") {
  const Zone good[] = {{}, {0, 0, 0.1, -50}},
             bad[] = {{0, 0, 0, 0}, {0, 101, 0.1}, {0, 0, 1, 2e12}};
  CHECK(std::ranges::all_of(good, &Zone::plausible));
  CHECK(std::ranges::none_of(bad, &Zone::plausible));
}

TEST_CASE("a verdict with an unknown word keeps its word and figures") {
  const Folder dir;
  a_small_run().write(dir / "run");
  damage(dir / "run", "verdict ?3 of the SPD in the records from ?1 to ?2",
         {std::int64_t{0}, std::int64_t{0}, std::string("too green: 7 %")});
  CHECK(verdict(RunReader(dir / "run").read(0), Sensor::spd) == "too green: 7 %");
}

// Writes 20 runs for tests/python/test_format.py, together with the values that RunReader reads
// from each run.
TEST_CASE("random runs are written as input for the test of the Python reader", "[.random_runs]") {
  const char* folder = std::getenv("ECHOFUSE_RANDOM_RUNS");
  REQUIRE(folder);
  for (unsigned seed = 100; seed < 120; ++seed) {
    const std::string path = std::string(folder) + "/" + std::to_string(seed) + ".sqlite";
    write_random(path, seed);
    std::ofstream out(path + ".read", std::ios::binary);
    const auto put = [&](ByteView bytes) {
      out.write(reinterpret_cast<const char*>(bytes.data()),
                static_cast<std::streamsize>(bytes.size()));
    };
    RunReader(path).for_each([&](const FusedRecord& r) {
      put(as_bytes(std::vector<std::int64_t>{r.index, r.slot_utc.count(), r.valid.bits()}));
      put(as_bytes(counts(r)));
      put(as_bytes(power(r)));
      put(as_bytes(depth_mm(r)));
      return true;
    });
  }
}
