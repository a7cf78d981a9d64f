// SPDX-License-Identifier: MIT
// Tests the ratings of devices and disks by doctor, with artificial samples and figures.
#include "acquire/record/columns.hpp"
#include "acquire/run/disk.hpp"
#include "captured.hpp"
#include "testing.hpp"

using namespace echofuse::acquire;

namespace {

constexpr double time_s = Capture::slot_s;

Config lab() {
  return load_config(source_dir + "/config/lab.toml",
                     {"depth.fps=10", "radar.cfg=radar/xwr68xx_paper_50cm.cfg"});
}

// Returns a thousand pairs of tags. Each pair consists of a start tag and a click `delay_ps` later.
std::vector<Tag> pairs(std::int32_t start, std::int32_t click, std::int64_t delay_ps) {
  std::vector<Tag> tags;
  for (std::int64_t k = 0; k < 1000; ++k) {
    tags.push_back({.channel = start, .time_ps = k * 1'000'000});
    tags.push_back({.channel = click, .time_ps = k * 1'000'000 + delay_ps});
  }
  return tags;
}

// The tags arrive in two blocks, because they must span half of the slot.
Finding spd_verdict(const std::vector<Tag>& tags, std::uint64_t lost_tags = 0) {
  const Config config = lab();
  const auto half = static_cast<std::ptrdiff_t>(tags.size() / 2);
  const std::vector<Tag> first(tags.begin(), tags.begin() + half),
      rest(tags.begin() + half, tags.end());
  return spd_finding(
      captured(config, device_of(Sensor::spd, {}),
               [&](Capture& capture) {
                 if (tags.empty()) return;
                 capture.on_tags({.received = doctor_begin, .tags = first});
                 capture.on_tags(
                     {.received = doctor_middle, .tags = rest, .lost_items = lost_tags});
               }),
      config);
}

double fact(const Finding& finding, const std::string& name) {
  for (const auto& [key, value] : finding.facts)
    if (key == name) return value;
  throw std::runtime_error("no fact " + name);
}

RadarFrame radar_frame(std::size_t bins = 64) {
  RadarFrame frame;
  frame.power.assign(bins, 20);
  if (bins > 7) frame.power[7] = 4000;
  return frame;
}

Finding radar_verdict(int frames, RadarFrame frame) {
  const Config config = lab();
  frame.received = doctor_middle;
  return radar_finding(
      captured(config, device_of(Sensor::radar, {radar::radar_axis(parse_profile(config.radar))}),
               [&](Capture& capture) {
                 for (int k = 0; k < frames; ++k) ++frame.frame_number, capture.on_radar(frame);
               }),
      config);
}

DepthFrame depth_frame(std::uint16_t z) {
  DepthFrame frame{.width = 20, .height = 10, .depth_mm = std::vector<std::uint16_t>(200, z)};
  frame.depth_mm[0] = 0;
  return frame;
}

Capture depth_capture(const Config& config, int frames, DepthFrame frame) {
  frame.received = doctor_middle;
  return captured(config, camera_of(frame.width, frame.height), [&](Capture& capture) {
    for (int k = 0; k < frames; ++k) ++frame.frame_number, capture.on_depth(frame);
  });
}

Finding depth_verdict(int frames, const DepthFrame& frame) {
  const Config config = lab();
  return depth_finding(depth_capture(config, frames, frame), config);
}

}  // namespace

TEST_CASE(
    "doctor reports detector faults, count rates and the fraction of clicks in the histogram") {
  const Finding good = spd_verdict(pairs(1, 2, 20'000));
  CAPTURE(good.found, good.advice);
  CHECK(good.grade == Grade::ok);
  CHECK(fact(good, "starts_per_s") == 500);
  CHECK(fact(good, "clicks_per_s") == 500);
  CHECK(fact(good, "share_in_range") == 1);
  const Finding far = spd_verdict(pairs(1, 2, 900'000));
  CHECK(far.grade == Grade::warning);
  CHECK(
      has(far.advice, "are the start and click channels swapped? If not, set tdc.click_delay_ps"));
  std::vector<Tag> swapped = pairs(1, 2, 20'000);
  for (std::size_t i = 0, n = swapped.size(); i < n; ++i)
    if (swapped[i].channel == 2)
      for (int k = 1; k <= 9; ++k)
        swapped.push_back({.channel = 2, .time_ps = swapped[i].time_ps + 50'000 * k});
  std::ranges::sort(swapped, {}, &Tag::time_ps);
  CHECK(has(spd_verdict(swapped).advice,
            "several clicks per start: are the start and click channels swapped?"));
  const Finding lossy = spd_verdict(pairs(1, 2, 20'000), 5);
  CHECK(lossy.grade == Grade::warning);
  CHECK(fact(lossy, "lost_tags") == 5);
  std::vector<Tag> invalid = pairs(1, 2, 20'000);
  for (Tag& tag : invalid) tag.reserved = 1;
  CHECK(has(spd_verdict(invalid).advice, "all tags are invalid"));
  const Finding no_laser = spd_verdict(pairs(3, 2, 20'000));
  CHECK(no_laser.grade == Grade::problem);
  CHECK(has(no_laser.advice, "no starts on tdc.start_channel = 1"));
  CHECK(has(no_laser.advice, "2 (500 Hz), 3 (500 Hz)"));
  const Finding dark = spd_verdict(pairs(1, 4, 20'000));
  CHECK(dark.grade == Grade::problem);
  CHECK(has(dark.advice, "no clicks on tdc.click_channel = 2"));
  CHECK(has(spd_verdict({}).advice, "no channel has tags"));
}

TEST_CASE(
    "doctor compares the radar frame rate with frameCfg and checks frame losses and profiles") {
  const Config config = lab();
  const Finding sample = radar_verdict(1, radar_frame());
  const double nominal = fact(sample, "nominal_frames_per_s");
  const int due = static_cast<int>(nominal * time_s);
  REQUIRE(due >= 20);
  CHECK(sample.grade == Grade::problem);
  const Finding good = radar_verdict(due, radar_frame());
  CAPTURE(good.found, good.advice);
  CHECK(good.grade == Grade::ok);
  CHECK(fact(good, "bins") == 64);
  CHECK(fact(good, "peak_over_median_db") > 10);
  CHECK(radar_verdict(due * 3 / 4, radar_frame()).grade == Grade::problem);
  CHECK(radar_verdict(due * 2, radar_frame()).grade == Grade::warning);
  RadarFrame after_loss = radar_frame();
  after_loss.lost_before = 1;
  CHECK(radar_verdict(due, after_loss).grade == Grade::warning);
  CHECK(has(radar_verdict(due, radar_frame(0)).advice, "guiMonitor"));
  CHECK(has(radar_verdict(due, radar_frame(32)).advice,
            "profile of the 64 bins that radar.cfg defines"));
  RadarFrame flat = radar_frame();
  flat.power[7] = 20;
  CHECK(has(radar_verdict(due, flat).advice, "all bins are equal"));
  CHECK(has(radar_verdict(0, flat).advice, "frame rate is lower"));
}

TEST_CASE(
    "the doctor command reports the frame rate of a camera and its fraction of valid pixels") {
  const Finding good = depth_verdict(20, depth_frame(3000));
  CHECK(good.grade == Grade::ok);
  CHECK(fact(good, "valid_share") == Approx(0.995));
  CHECK(has(good.found, "10 frames/s, expected 10, 0 lost; 20 x 10 pixels"));
  CHECK(depth_verdict(10, depth_frame(3000)).grade == Grade::problem);
  CHECK(has(depth_verdict(0, depth_frame(3000)).advice, "frame rate is lower"));
  const Finding covered = depth_verdict(20, depth_frame(0));
  CHECK(covered.grade == Grade::warning);
  CHECK(has(covered.advice, "covered"));
}

TEST_CASE("doctor reports the count rate of each detector zone and marks zones without counts") {
  const Config config = lab();
  DeviceInfo board = device_of(Sensor::spd, {{"spd", "counts", "ps", 2, 0, 100}});
  board.axes[0].zones.resize(3);
  const Capture capture = captured(config, board, [](Capture& c) {
    for (const int tenths : {2, 18})
      c.on_histogram({.received = doctor_begin + std::chrono::milliseconds(100 * tenths),
                      .exposure_us = 1000,
                      .zones = 3,
                      .counts = {1, 3, 0, 0, 2, 0}});
  });
  const Finding found = spd_finding(capture, config);
  CHECK(found.found == "counts 6 Hz, 0 histograms lost; zones 4 Hz 0 Hz 2 Hz");
  CHECK(found.grade == Grade::warning);
  CHECK(has(found.advice, "zone 1 has no counts"));
  CHECK(estimate_record_bytes(capture, config) == 4.0 * 6 + 4.0 * 64 + 2.0 * 640 * 480);
}

TEST_CASE("doctor does not report missing counts if the exposures are longer than its slot") {
  const Config config = lab();
  const Finding found = spd_finding(
      captured(
          config, device_of(Sensor::spd, {{"spd", "counts", "ps", 2, 0, 100}}),
          [](Capture& c) {
            c.on_histogram({.received = doctor_middle, .exposure_us = 2'500'000, .counts = {1, 3}});
          }),
      config);
  CHECK(found.grade == Grade::warning);
  CHECK(found.advice == "doctor reads 2 s, which is too short for exposures of 2.5 s");
}

TEST_CASE("the doctor command reports each device warning once and ignores information messages") {
  const Config config = lab();
  Capture capture(config);
  capture.on_event(Sensor::radar, Severity::warning, "swapped?");
  capture.on_event(Sensor::radar, Severity::warning, "swapped?");
  capture.on_event(Sensor::radar, Severity::info, "started");
  CHECK(capture.complaints[Sensor::radar] == std::vector<std::string>{"swapped?"});
  CHECK(capture.complaints[Sensor::spd].empty());
}

TEST_CASE("the record size is estimated from received frames, or else from the configuration") {
  const Config config = lab();
  const double unseen = estimate_record_bytes(Capture(config), config);
  CHECK(unseen == 4.0 * 336 + 4.0 * 64 + 2.0 * 640 * 480);
  const double seen = estimate_record_bytes(depth_capture(config, 1, depth_frame(3000)), config);
  CHECK(seen > 4.0 * 336 + 4.0 * 64);
  CHECK(seen < 4.0 * 336 + 4.0 * 64 + 2.0 * 200);
}

TEST_CASE("the doctor command rates the disk's write speed as ok, warning or problem") {
  // Each 1 MB record is written twice within 2 s, so the run needs a write speed of 1 MB/s.
  const PlannedRun plan{.folder = "/d", .record_bytes = 1e6, .window_s = 2};
  const auto grade = [&](double rate, double median_s, double longest_s) {
    return speed_finding({rate, median_s, longest_s, 1'000'000}, plan).grade;
  };
  CHECK(grade(100e6, 0.01, 0.02) == Grade::ok);
  CHECK(grade(2e6, 0.01, 0.02) == Grade::warning);
  CHECK(grade(100e6, 0.01, 2.5) == Grade::warning);
  CHECK(grade(0.5e6, 0.01, 0.02) == Grade::problem);
  CHECK(grade(100e6, 2.5, 2.5) == Grade::problem);
  // Without a planned run, no write speed is required.
  CHECK(speed_finding({1, 10, 10, 1000}, {.folder = "/d"}).grade == Grade::ok);
}

TEST_CASE("the doctor command rates the free disk space as ok, warning or problem") {
  PlannedRun plan{.folder = "/d", .record_bytes = 1e6, .window_s = 3, .count = 4000};
  CHECK(space_finding(5e9, plan).grade == Grade::ok);
  const Finding full = space_finding(3.9e9, plan);
  CHECK(full.grade == Grade::problem);
  CHECK(full.failure == ExitCode::disk);
  CHECK(has(full.found, "4000 records of 1.0 MB each, including the journal, need 4.0 GB"));
  plan.count.reset();
  CHECK(space_finding(3.9e9, plan).grade == Grade::ok);
  CHECK(has(space_finding(3.9e9, plan).found, "enough for 3 h"));
  CHECK(space_finding(0.5e9, plan).grade == Grade::warning);
  CHECK(space_finding(3.9e9, plan, 86'400).grade == Grade::warning);
  auto axes = small_axes();
  CHECK(record::record_bytes(axes) == 4 * 8 + 4 * 4 + 2 * 3 * 2);
  axes[0].zones.resize(9);
  CHECK(record::record_bytes(axes) == 9 * 4 * 8 + 4 * 4 + 2 * 3 * 2);
  // A record needs 100 kB, including 2048 bytes for its row. A run of 1000 records needs 117 MB,
  // including 17 MB for the WAL.
  plan = {.record_bytes = 97'952, .window_s = 3, .count = 1000};
  CHECK(space_finding(117e6, plan).grade == Grade::ok);
  CHECK(space_finding(116e6, plan).grade == Grade::problem);
}

TEST_CASE("doctor's disk test leaves no files and rates a missing folder as a problem") {
  const Folder folder;
  const DiskSpeed speed = measure_disk(folder / "", 100'000);
  CHECK(speed.bytes_per_s > 0);
  CHECK(speed.commit_median_s > 0);
  CHECK(speed.commit_longest_s >= speed.commit_median_s);
  CHECK(fs::is_empty(folder / ""));
  const auto findings = check_disk({.folder = folder / "none"});
  REQUIRE(findings.size() == 1);
  CHECK(findings[0].grade == Grade::problem);
  CHECK(findings[0].failure == ExitCode::disk);
  CHECK(has(findings[0].found, "none: cannot be used for a run: No such file"));
}
