// SPDX-License-Identifier: MIT
// Tests commands that use devices, in virtual time: stopping a run, the firmware check, late data,
// calibrate and doctor.

#include "../drivers/sink.hpp"
#include "acquire/calibrate/calibrate.hpp"
#include "acquire/config/calibration.hpp"
#include "acquire/devices/device_check.hpp"
#include "acquire/doctor/doctor.hpp"
#include "bench.hpp"

using namespace echofuse::test;
using namespace std::chrono_literals;

namespace {

// Sends a range profile with an echo at range_m. The profile has 100 bins of 0.08 m and begins at
// 0.3 m.
auto echo_at(double range_m) {
  return [range_m, rng = make_rng(3, 1)](BridgedDevice& radar) mutable {
    constexpr std::uint32_t bins = 100;
    constexpr auto profile = static_cast<sim::BlockKind>(5);
    Bytes payload;
    put(payload, bins);
    put(payload, radar.number());
    put(payload, std::uint64_t{50'000} * radar.number());
    put(payload, 0.3F), put(payload, 0.08F);
    std::exponential_distribution<float> noise(1);
    for (std::uint32_t i = 0; i < bins; ++i) {
      const double off = (0.3 + 0.08 * i - range_m) / 0.1;
      put(payload, noise(rng) + static_cast<float>(1e3 * std::exp(-off * off)));
    }
    radar.send(profile, payload);
  };
}

constexpr double spd_m = 437 * speed_of_light_m_s / 2e12, radar_m = 0.037;

// Returns a laboratory with a reflector at 1 m. The simulated sensors have range offsets.
LaboratoryOptions reflector(double more_ps = 0, const std::string& before = "detector") {
  return {.signal_photons = 4e5,
          .scene = "reflector",
          .radar_cfg = "xwr68xx_44mm.cfg",
          .change = [=](sim::Conditions& c) {
            c.first_bin_ps = 1000, c.spd_rays = sim::Conditions{}.spd_rays,
            c.spd_delay_ps = 437 + more_ps, c.radar_bias_m = radar_m;
            c.reflector_before = before;
          }};
}

// Assumes an exact reflector position, so that the standard errors contain only the measurement
// error.
ExitCode calibrate(Laboratory& lab, bool check = false, acquire::CalibrateOptions options = {},
                   double time_s = 0.5, std::int64_t repeats = 6) {
  options.check = check;
  options.distance_error_m = options.baseline_error_m = 0;
  options.repeats = repeats, options.time_s = time_s;
  options.search.window_m = 0.3;
  options.json = true;
  return acquire::calibrate(lab.config(), options, lab.loop);
}

}  // namespace

TEST_CASE("the radar is stopped after a run or a failed start unless radar.keep_running is set") {
  const auto [setting, tagger, radiates] =
      GENERATE(table<std::string, bool, bool>({{"radar.keep_running=false", true, false},
                                               {"radar.keep_running=true", true, true},
                                               {"tdc.policy=required", false, false}}));
  CAPTURE(setting);
  Bench b;
  b.lab->set({setting});
  if (tagger) {
    b.record(2);
  } else {
    b.lab->loop.ports.erase(b.lab->config().tdc.address);
    CHECK_THROWS_WITH(b.lab->record(b.run(2)), Catch::Contains("a required device"));
    b.lab->loop.run_for(1s);
  }
  CHECK(b.lab->radar_radiates() == radiates);
}

TEST_CASE("a radar that does not answer sensorStop causes a warning and a short delay") {
  Bench b;
  port::Timer choke(b.lab->loop);
  choke.after(10s, [&] { b.lab->choke_radar(true); });
  b.record(6);
  CHECK(has(b.events("radar"), "the device did not confirm the stop and may still be sending"));
}

TEST_CASE("the calibrate command measures and stores offsets, and a run uses them") {
  Bench b(reflector());
  const std::string stored = b.folder / "calibration.toml";
  b.lab->set({"run.calibration=" + stored}, false);
  CHECK_THROWS_WITH(calibrate(*b.lab, true),
                    Catch::Contains("run.calibration contains nothing to compare with"));
  REQUIRE(calibrate(*b.lab) == ExitCode::ok);
  const acquire::Calibration measured = acquire::read_calibration(stored);
  b.lab->set({"run.calibration=" + stored});
  for (const auto& [sensor, true_m] : {std::pair{Sensor::spd, spd_m}, {Sensor::radar, radar_m}}) {
    const record::CalibrationEntry* entry = measured.find(sensor);
    REQUIRE(entry);
    // On average, points on the reflector plate are less than 0.02 mm farther away than the centre
    // of the plate.
    CHECK(std::abs(entry->offset_m - true_m) < 5 * entry->standard_error_m + 2e-5);
    CHECK(entry->standard_error_m < 3e-4);
  }
  acquire::CalibrateOptions stated;
  stated.search.distance_m = 3;  // not given by the user, so the stored distance of 1 m counts
  CHECK(calibrate(*b.lab, true, stated) == ExitCode::ok);
  stated.distance_given = true;
  CHECK(calibrate(*b.lab, true, stated) != ExitCode::ok);
  b.record(1);
  const auto named = b.reader().calibrations();
  REQUIRE(named.size() == 2);
  CHECK(named[0].offset_m == measured.entries[0].offset_m);
  // Calibrating one sensor must keep the entry of the other sensor.
  b.lab->set({"radar.cli=", "radar.data="});
  b.lab->loop.run_for(100s);
  REQUIRE(calibrate(*b.lab) == ExitCode::ok);
  const acquire::Calibration again = acquire::read_calibration(stored);
  CHECK(again.find(Sensor::radar)->offset_m == measured.find(Sensor::radar)->offset_m);
  CHECK(again.find(Sensor::spd)->offset_m != measured.find(Sensor::spd)->offset_m);
  Bench slipped(reflector(200));
  slipped.lab->set({"run.calibration=" + stored});
  CHECK(calibrate(*slipped.lab, true) == ExitCode::failed);
}

TEST_CASE(
    "both reflector mountings give equal range offsets, and a wrong mounting causes an error") {
  const auto stated = GENERATE(acquire::Mounting::detector, acquire::Mounting::each);
  const std::string placed = GENERATE("detector", "each");
  CAPTURE(acquire::name_of(stated), placed);
  Bench b(reflector(0, placed));
  const std::string stored = b.folder / "c.toml";
  b.lab->set({"run.calibration=" + stored}, false);
  acquire::CalibrateOptions options;
  options.mounting = stated;
  const bool right = placed == acquire::name_of(stated);
  options.only = Sensor::radar;
  CHECK(calibrate(*b.lab, false, options) == (right ? ExitCode::ok : ExitCode::device));
  CHECK(std::filesystem::exists(stored) == right);
  options.only = Sensor::spd;
  CHECK(calibrate(*b.lab, false, options) == ExitCode::ok);
  const acquire::Calibration c = acquire::read_calibration(stored);
  REQUIRE(c.find(Sensor::spd));
  CHECK(std::abs(c.find(Sensor::spd)->offset_m - spd_m) < 2e-3);
  REQUIRE((c.find(Sensor::radar) != nullptr) == right);
  if (!right) return;
  CHECK(std::abs(c.find(Sensor::radar)->offset_m - radar_m) < 2e-3);
  CHECK(c.find(Sensor::radar)->distance_m ==
        Approx(stated == acquire::Mounting::detector ? 1.118034 : 1));
  CHECK(c.baseline_m == 0.5);
  // A file that contains only the radar states the distance from the radar. The reflector would not
  // be found at 3 m.
  options.only = Sensor::radar;
  std::filesystem::remove(stored);
  CHECK(calibrate(*b.lab, false, options) == ExitCode::ok);
  b.lab->set({"run.calibration=" + stored});
  options.search.distance_m = 3;
  CHECK(calibrate(*b.lab, true, options) != ExitCode::device);
}

TEST_CASE("antenna calibration recovers gains and phases for both reflector mountings") {
  const std::string placed = GENERATE("detector", "each");
  LaboratoryOptions options = reflector(0, placed);
  options.radar_cfg = "xwr68xx_azimuth_44mm.cfg";
  options.change = [change = options.change](sim::Conditions& c) {
    change(c);
    c.radar_snr_db = 45;
  };
  CAPTURE(placed);
  Bench b(options);
  const std::string stored = b.folder / "c.toml";
  b.lab->set({"run.calibration=" + stored}, false);
  acquire::CalibrateOptions calibration;
  if (placed == "each") calibration.mounting = acquire::Mounting::each;
  calibration.only = Sensor::radar;
  REQUIRE(calibrate(*b.lab, false, calibration) == ExitCode::ok);
  const acquire::AntennaGains& gains = acquire::read_calibration(stored).antennas;
  REQUIRE(gains.gain.size() == 8);
  CHECK(gains.sine == Approx(placed == "each" ? 0 : 0.447214));
  for (std::size_t m = 1; m < gains.gain.size(); ++m) {  // all simulated antenna channels are equal
    CHECK(std::abs(gains.phase_rad[m]) < 5 * gains.standard_error[m] + 4e-3);
    CHECK(std::abs(gains.gain[m] - 1) < 5 * gains.standard_error[m]);
    CHECK(gains.standard_error[m] < 0.003);
  }
}

TEST_CASE("a radar that is connected through a bridge is calibrated with its range profile") {
  Bench b(reflector());
  const std::string stored = b.folder / "c.toml";
  BridgedDevice device(b.lab->loop, R"({"model":"R","serial":"R1","firmware":"1"})",
                       echo_at(std::hypot(1, 0.5) + 0.021));
  device.attach(b, "radar.address", {"run.calibration=" + stored});
  acquire::CalibrateOptions options;
  options.only = Sensor::radar;
  REQUIRE(calibrate(*b.lab, false, options) == ExitCode::ok);
  const acquire::Calibration c = acquire::read_calibration(stored);
  const record::CalibrationEntry* entry = c.find(Sensor::radar);
  REQUIRE(entry);
  CHECK(entry->serial == "R1");
  CHECK(std::abs(entry->offset_m - 0.021) < 3 * entry->standard_error_m);
  CHECK(entry->standard_error_m < 3e-3);
  CHECK(c.axes.radar.step == Approx(0.08));
  CHECK(c.axes.radar.count == 100);
  CHECK_FALSE(c.response.radar.known());
  b.lab->set({"run.calibration=" + stored});
  CHECK(calibrate(*b.lab, true, options) == ExitCode::ok);
  options.mounting = acquire::Mounting::each;
  CHECK(calibrate(*b.lab, false, options) == ExitCode::device);
}

TEST_CASE("a failed calibration is not stored") {
  LaboratoryOptions laboratory = reflector();
  acquire::CalibrateOptions options;
  std::vector<std::string> settings;
  double time_s = 0.5;
  SECTION(
      "a calibration from one frame per repeat is not stored, because the values do not scatter") {
    laboratory.radar_cfg = "xwr68xx_azimuth_44mm.cfg";
    options.only = Sensor::radar;
    time_s = 0.12;
  }
  SECTION("a calibration is not stored if there is no reflector") { laboratory.scene = "empty"; }
  SECTION("a calibration with a saturated detector is not stored") {
    laboratory.laser_rate_hz = 1e4;
    settings = {"radar.cli=", "radar.data="};
  }
  Bench b(laboratory);
  settings.push_back("run.calibration=" + b.folder / "c.toml");
  b.lab->set(settings, false);
  CHECK(calibrate(*b.lab, false, options, time_s, time_s < 0.5 ? 12 : 6) == ExitCode::device);
  CHECK_FALSE(std::filesystem::exists(b.folder / "c.toml"));
}

TEST_CASE("the doctor command reports a blocked laser with the same verdict as a run") {
  const auto said = [](double photons) {
    Bench b({.signal_photons = photons,
             .change = [](sim::Conditions& c) { c.background_counts = 1000; }});
    b.lab->set({"run.folder=" + b.folder / "", "radar.cli=", "radar.data="});
    ExitCode code{};
    const std::string text = printed_by(
        b.folder / "said", [&] { code = acquire::examine(b.lab->config(), {}, b.lab->loop); });
    CHECK(code == ExitCode::ok);
    return text;
  };
  CHECK_THAT(said(3000), Catch::Contains("\nok       spd  "));
  const std::string blocked = said(0.1);
  CHECK_THAT(blocked,
             Catch::Contains("\nwarning  spd  ") && Catch::Contains("-> no peak: no bins"));
}

TEST_CASE("doctor exits with the code of its first problem, and lists device problems first") {
  Bench b;
  const auto examine = [&](std::int64_t count) {
    acquire::DoctorOptions options;
    options.count = count;
    return acquire::examine(b.lab->config(), options, b.lab->loop);
  };
  constexpr std::int64_t too_many = 1'000'000'000'000;
  b.lab->set({"run.folder=" + b.folder / ""});
  SECTION("a missing radar determines the exit code of doctor even if the disk is also full") {
    b.unplug_radar();
  }
  SECTION("a detector fault determines the exit code of doctor even if the disk is also full") {
    b.lab->set({"radar.cli=", "radar.data="});
    CHECK(examine(40) == ExitCode::ok);
    CHECK(examine(too_many) == ExitCode::disk);
    b.lab->set({"tdc.start_channel=7"});
  }
  CHECK(examine(too_many) == ExitCode::device);
}

TEST_CASE("a reconnected bridge that sends no tags is not described by its closed connection") {
  Bench b;
  bool left = false;
  BridgedDevice device(b.lab->loop, R"({"model":"B","serial":"B1","firmware":"1"})",
                       [&](BridgedDevice& bridge) {
                         if (!std::exchange(left, true)) bridge.send(sim::BlockKind::bye, {});
                       });
  device.attach(b, "tdc.address", {"depth.address="});
  CHECK_THROWS_WITH(b.lab->record(b.run(1)), Catch::Contains("answers, but sends no tags"));
}

TEST_CASE("run, doctor and devices state why the data of a bridge are not used") {
  struct Row {
    std::string hello;  // keys in addition to model, serial and firmware
    sim::BlockKind kind;
    Bytes payload;
    const char* reason;
  };
  const auto histogram = [](std::uint32_t count, std::uint32_t exposure_us) {
    return sim::histogram_payload(std::vector<std::uint32_t>(64, count), 64, 0, 5000, 0, 100,
                                  exposure_us);
  };
  const std::string board = R"(,"sends":"histograms")";
  const auto tags = sim::BlockKind::tags, counts = sim::BlockKind::histogram;
  const Row row = GENERATE_COPY(
      Row{"", tags, Bytes(15), "its tags have a size that is not a multiple of 16 bytes"},
      Row{"", counts, histogram(1, 50'000),
          "this bridge sends histograms, not tags; add \"sends\""},
      Row{board, tags, Bytes(16), "this bridge sends tags, not histograms"},
      Row{board, counts, histogram(1, 0), "its histograms have exposure time 0"},
      Row{board, counts, histogram(UINT32_MAX, 50'000), "bin 0 contains 4294967295 counts"},
      Row{R"(,"zones":4)", tags, Bytes(16), "the hello block is not valid: \"zones\""},
      Row{"", static_cast<sim::BlockKind>(7), {}, "wrong block header: the block kind"});
  CAPTURE(row.reason);
  Bench b;
  BridgedDevice device(b.lab->loop,
                       R"({"model":"B","serial":"B1","firmware":"1")" + row.hello + "}",
                       [&](BridgedDevice& bridge) { bridge.send(row.kind, row.payload); });
  device.attach(b, "tdc.address", {"depth.address="});
  CHECK_THROWS_WITH(b.lab->record(b.run(1)), Catch::Contains(row.reason));
  for (const std::string& said :
       {printed_by(b.folder / "said",
                   [&] { acquire::list_devices(b.lab->config(), b.lab->loop, false); }),
        printed_by(b.folder / "said", [&] { acquire::examine(b.lab->config(), {}, b.lab->loop); })})
    CHECK_THAT(said, Catch::Contains(row.reason) && !Catch::Contains("sends no tags"));
}

TEST_CASE("a simulated histogram shows the scene at the middle of its exposure") {
  port::VirtualLoop loop;
  sim::SceneSchedule schedule{.hold_s = 0.06};
  schedule.list = {sim::SceneKind::empty, sim::SceneKind::person};
  sim::ScenePlayer player(loop, {.spd_zones = 2}, schedule);
  auto listener = std::make_unique<MemoryListener>(loop);
  loop.ports["bridge:tcp://detector:1"] = listener->opener();
  const auto detector = sim::make_histogram_bridge(loop, player, {}, std::move(listener));
  KeepingSink sink;
  const auto driver = make_tdc(loop, {"bridge:tcp://detector:1"});
  driver->start(sink);
  REQUIRE(run_until(loop, [&] { return sink.histograms.size() == 24; }));
  const double hold_s = schedule.hold_s;
  int between = 0;  // exposures that contain the end of a scene after their middle
  for (const HistogramFrame& histogram : sink.histograms) {
    const double end_s = seconds(histogram.received), middle_s = end_s - 0.025;
    const auto scene = [&](double time_s) { return std::floor(time_s / hold_s + 1e-9); };
    const bool person = std::fmod(scene(middle_s) - scene(1), 2) == 1;
    between += scene(end_s) != scene(middle_s);
    const std::uint64_t counts = histogram.clicks();
    CAPTURE(end_s, counts);
    CHECK((counts > 500) == person);
  }
  CHECK(between > 5);
  detector->stop();
  loop.run_for(1s);
}
