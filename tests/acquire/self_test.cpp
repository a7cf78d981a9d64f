// SPDX-License-Identifier: MIT
// Tests the ratings of devices and disks by doctor, with artificial samples and figures.
#include "acquire/record/columns.hpp"
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
Finding spd_verdict(const std::vector<Tag>& tags, std::uint64_t lost = 0) {
  const Config config = lab();
  const std::span all(tags);
  const auto send = [&](Capture& capture) {
    if (tags.empty()) return;
    capture.on_tags({.received = doctor_begin, .tags = all.first(tags.size() / 2)});
    capture.on_tags(
        {.received = doctor_middle, .tags = all.subspan(tags.size() / 2), .lost_items = lost});
  };
  return spd_finding(captured(config, device_of(Sensor::spd, {}), send), config);
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
  const DeviceInfo device = device_of(Sensor::radar, {radar_axis(parse_profile(config.radar))});
  const auto send = [&](Capture& capture) {
    for (int k = 0; k < frames; ++k) ++frame.frame_number, capture.on_radar(frame);
  };
  return radar_finding(captured(config, device, send), config);
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

TEST_CASE("doctor reports the faults and rates of a detector") {
  const std::vector<Tag> tags = pairs(1, 2, 20'000);
  const Finding good = spd_verdict(tags);
  check_finding(good, Grade::ok, "starts 500 Hz, clicks 500 Hz, 100 % of the clicks in the");
  for (const char* name : {"starts_per_s", "clicks_per_s"}) CHECK(fact(good, name) == 500);
  CHECK(fact(good, "share_in_range") == 1);
  check_finding(spd_verdict(pairs(1, 2, 900'000)), Grade::warning, ", 0 % of the clicks in the");
  std::vector<Tag> swapped = tags, invalid = tags, back = tags;
  for (const Tag& tag : tags)
    for (int k = 1; k <= 9 && tag.channel == 2; ++k)
      swapped.push_back({.channel = 2, .time_ps = tag.time_ps + 50'000 * k});
  std::ranges::sort(swapped, {}, &Tag::time_ps);
  check_finding(spd_verdict(swapped), Grade::warning,
                "several clicks per start: are the start and click channels swapped? If not, set "
                "tdc.click_delay_ps");
  std::ranges::rotate(back, back.begin() + 1000);
  check_finding(spd_verdict(back), Grade::warning, "the tagger reports errors or sends invalid");
  const Finding lossy = spd_verdict(tags, 5);
  check_finding(lossy, Grade::warning, "5 tags and 0 blocks lost; the tagger or its connection is");
  CHECK(fact(lossy, "lost_tags") == 5);
  for (Tag& tag : invalid) tag.reserved = 1;
  check_finding(spd_verdict(invalid), Grade::problem, "all tags are invalid");
  check_finding(spd_verdict(pairs(3, 2, 20'000)), Grade::problem,
                "no starts on tdc.start_channel = 1; check the laser; channels with tags: "
                "2 (500 Hz), 3 (500 Hz)");
  check_finding(spd_verdict(pairs(1, 4, 20'000)), Grade::problem, "no clicks on tdc.click_channel");
  check_finding(spd_verdict({}), Grade::problem, "no channel has tags");
}

TEST_CASE("doctor checks the frame rate, the losses and the profiles of a radar") {
  const int due =
      static_cast<int>(fact(radar_verdict(1, radar_frame()), "nominal_frames_per_s") * time_s);
  REQUIRE(due >= 20);
  const Finding good = radar_verdict(due, radar_frame());
  check_finding(good, Grade::ok);
  CHECK(fact(good, "bins") == 64);
  CHECK(fact(good, "peak_over_median_db") > 10);
  RadarFrame after_loss = radar_frame(), flat = radar_frame();
  after_loss.lost_before = 1, flat.power[7] = 20;
  // One frame more or less than expected may be due to the times at which doctor reads.
  for (const auto& [frames, frame, grade, words] :
       {std::tuple(due * 9 / 10 - 1, radar_frame(), Grade::ok, ""),
        {due * 9 / 10 - 2, radar_frame(), Grade::problem, "frame rate is lower than configured"},
        {due * 10 / 9 + 1, radar_frame(), Grade::ok, ""},
        {due * 10 / 9 + 2, radar_frame(), Grade::warning, "frame rate is higher than configured"},
        {0, flat, Grade::problem, "frame rate is lower than configured"},
        {due, after_loss, Grade::warning, "check the cable, and that radar.data_baud matches"},
        {due, radar_frame(0), Grade::problem, "guiMonitor"},
        {due, radar_frame(32), Grade::problem, "profile of the 64 bins that radar.cfg defines"},
        {due, flat, Grade::problem, "all bins are equal"}})
    check_finding(radar_verdict(frames, frame), grade, words);
}

TEST_CASE("doctor reports the frame rate of a camera and its fraction of valid pixels") {
  const Finding good = depth_verdict(20, depth_frame(3000));
  check_finding(good, Grade::ok, "10 frames/s, expected 10, 0 lost; 20 x 10 pixels, 100 % of them");
  CHECK(fact(good, "valid_share") == Approx(0.995));
  for (const int frames : {0, 10})
    check_finding(depth_verdict(frames, depth_frame(3000)), Grade::problem, "frame rate is lower");
  check_finding(depth_verdict(20, depth_frame(0)), Grade::warning, "covered");
  DepthFrame after_loss = depth_frame(3000);
  after_loss.lost_before = 1;
  check_finding(depth_verdict(20, after_loss), Grade::warning, "the USB port or this machine");
  DepthFrame cut = depth_frame(3000);
  cut.depth_mm.pop_back();
  check_finding(depth_verdict(20, cut), Grade::problem, "no frame of the expected size received");
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
  check_finding(found, Grade::warning,
                "counts 6 Hz, 0 histograms lost; zones 4 Hz 0 Hz 2 Hz; zone 1 has no counts");
  CHECK(fact(found, "zone_2_clicks_per_s") == 2);
  CHECK(estimate_record_bytes(capture, config) == 4.0 * 6 + 4.0 * 64 + 2.0 * 640 * 480);
}

TEST_CASE("doctor does not report missing counts if the exposures are longer than its slot") {
  Config config = lab();
  const DeviceInfo board = device_of(Sensor::spd, {{"spd", "counts", "ps", 2, 0, 100}});
  const std::string words = "; doctor reads 2 s, which is too short for exposures of 2.5 s";
  const Capture capture = captured(config, board, [](Capture& c) {
    c.on_histogram({.received = doctor_middle, .exposure_us = 2'500'000, .counts = {1, 3}});
  });
  check_finding(spd_finding(capture, config), Grade::warning, words);
  config.window_s = 2.4;
  check_finding(spd_finding(capture, config), Grade::problem, words);
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
  Config bridged = config;  // the axis of its radar is unknown
  auto& radar = bridged.radar;
  radar = {}, radar.address = "bridge:tcp://h:1";
  CHECK(estimate_record_bytes(Capture(bridged), bridged) == 4.0 * 336 + 2.0 * 640 * 480);
}

TEST_CASE("the doctor command rates the disk's write speed as ok, warning or problem") {
  // Each 1 MB record is written twice within 2 s, so the run needs a write speed of 1 MB/s.
  const PlannedRun plan{.folder = "/d", .record_bytes = 1e6, .window_s = 2};
  for (const auto& [rate, median_s, longest_s, grade] : {std::tuple(100e6, 0.01, 0.02, Grade::ok),
                                                         {2e6, 0.01, 0.02, Grade::warning},
                                                         {100e6, 0.01, 2.5, Grade::warning},
                                                         {0.5e6, 0.01, 0.02, Grade::problem},
                                                         {100e6, 2.5, 2.5, Grade::problem}})
    check_finding(speed_finding({rate, median_s, longest_s, 1'000'000}, plan), grade);
  // Without a planned run, no write speed is required.
  check_finding(speed_finding({1, 10, 10, 1000}, {.folder = "/d"}), Grade::ok);
}

TEST_CASE("the doctor command rates the free disk space as ok, warning or problem") {
  PlannedRun plan{.folder = "/d", .record_bytes = 1e6, .window_s = 3, .count = 4000};
  check_finding(space_finding(5e9, plan), Grade::ok);
  const Finding full = space_finding(3.9e9, plan);
  check_finding(full, Grade::problem, "4000 records of 1.0 MB each, including the journal, need");
  CHECK(full.failure == ExitCode::disk);
  plan.count.reset();
  check_finding(space_finding(3.9e9, plan), Grade::ok, "enough for 3 h");
  check_finding(space_finding(0.5e9, plan), Grade::warning);
  check_finding(space_finding(3.9e9, plan, 86'400), Grade::warning);
  auto axes = small_axes();
  axes[0].zones.resize(9);
  CHECK(record::record_bytes(axes) == 9 * 4 * 8 + 4 * 4 + 2 * 3 * 2);
  // A record needs 100 kB, including 2048 bytes for its row. A run of 1000 records needs 117 MB,
  // including 17 MB for the WAL.
  plan = {.record_bytes = 97'952, .window_s = 3, .count = 1000};
  check_finding(space_finding(117e6, plan), Grade::ok);
  check_finding(space_finding(116e6, plan), Grade::problem);
}

TEST_CASE("doctor's disk test leaves no files and rates a missing folder as a problem") {
  const Folder folder;
  const DiskSpeed speed = measure_disk(folder / "", 100'000);
  CHECK((speed.bytes_per_s > 0 && speed.commit_median_s > 0));
  CHECK(speed.commit_longest_s >= speed.commit_median_s);
  CHECK(fs::is_empty(folder / ""));
  const auto findings = check_disk({.folder = folder / "none"});
  REQUIRE(findings.size() == 1);
  check_finding(findings[0], Grade::problem, "none: cannot be used for a run: No such file");
  CHECK(findings[0].failure == ExitCode::disk);
}
