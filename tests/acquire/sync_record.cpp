// SPDX-License-Identifier: MIT
// Tests how a run file and the output of the command info report sensor policies, incomplete
// records and clock fits.
#include <nlohmann/json.hpp>

#include "acquire/record/sqlite.hpp"
#include "testing.hpp"

using namespace echofuse::record;

namespace {

using Json = nlohmann::json;

void write(const std::string& path) {
  const auto change = [](FusedRecord& r) {
    const std::int64_t i = r.index;
    if (i == 1) r.missing = SensorSet::from_bits(5);
    if (i == 1)
      r.signal = {.clicks_per_pulse = 0.02,
                  .spd_clicks = 1234,
                  .spd_peak_m = {},
                  .radar_snr_db = 20.5,
                  .radar_peak_m = 3.25,
                  .depth_share = 0};
    if (i == 2) set_verdict(r, Sensor::spd, "weak: 98 clicks");
    if (i > 0)
      r.clocks[Sensor::spd] = ClockState{1.5, -3, 1e-4, static_cast<std::uint64_t>(100 + i)};
    if (i == 1) r.clocks[Sensor::depth] = ClockState{-7, 20, 2e-3, 64};
  };
  a_small_run(3)
      .policy(Sensor::spd, "required")
      .policy(Sensor::depth, "optional")
      .each(change)
      .write(path);
}

}  // namespace

TEST_CASE(
    "clock fits are stored, and records that lack a required sensor are counted as incomplete") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  write(path);
  CHECK(sql(path, "SELECT idx || ' ' || missing FROM record WHERE missing") == "1 5\n");
  CHECK(sql(path, "SELECT idx FROM record WHERE spd_clock_samples") == "1\n2\n");
  CHECK(sql(path,
            "SELECT spd_clock_offset_s || ' ' || spd_clock_drift_ppm || ' ' || "
            "spd_clock_residual_s || ' ' || spd_clock_samples || ' ' || "
            "(radar_clock_offset_s IS NULL) || (depth_clock_samples IS NULL) "
            "FROM record WHERE idx = 2") == "1.5 -3.0 0.0001 102 11\n");
  const Json info = Json::parse(test::acquire("info --json " + path).text);
  CHECK(info["incomplete"] == 1);
  CHECK(info["policy"] == Json{{"spd", "required"}, {"depth", "optional"}});
  // Value from the last record that contains a clock fit.
  CHECK(info["clocks"]["spd"]["samples"] == 102);
  CHECK(info["clocks"]["depth"]["drift_ppm"] == 20);
  CHECK_FALSE(info["clocks"].contains("radar"));
  const std::string text = test::acquire("info " + path).text;
  CHECK(has(text, "policy    depth optional, spd required; incomplete 1"));
  CHECK(has(text, "clock     spd: offset 1.5 s, drift -3 ppm, residual 100 µs, 102 samples"));
  CHECK(has(text, "axis      spd: 8 x 100 ps from 13343 ps, counts"));
  CHECK(has(text, "axis      depth_x: 3 x 0.2 from -0.2, tangent"));
}

TEST_CASE("the signal values of records are stored, and the verdicts are counted by kind") {
  const Folder folder;
  const std::string path = folder / "a.sqlite";
  write(path);
  CHECK(RunReader(path).read(0).signal == Signal{});
  CHECK(RunReader(path).read(1).signal == Signal{0.02, 1234, {}, 20.5, 3.25, 0});
  const auto verdicts = RunReader(path).summary().verdicts.by_sensor;
  CHECK(verdicts[Sensor::spd] ==
        std::map<VerdictKind, std::int64_t>{{VerdictKind::ok, 2}, {VerdictKind::weak, 1}});
  CHECK(verdicts[Sensor::radar] == std::map<VerdictKind, std::int64_t>{{VerdictKind::ok, 3}});
}
