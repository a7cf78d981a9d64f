// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cinttypes>
#include <numeric>

#include "acquire/doctor/doctor.hpp"
#include "acquire/intake/tag_check.hpp"
#include "acquire/record/columns.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

constexpr double slow = 0.9;  // lowest accepted fraction of the nominal rate

double rate(std::uint64_t count) { return static_cast<double>(count) / Capture::slot_s; }

double share(std::uint64_t part, std::uint64_t whole) {
  return whole ? static_cast<double>(part) / static_cast<double>(whole) : 0;
}

// Sets the advice for the first fault. Further faults can only raise the grade.
void mark(Finding& finding, Grade grade, const std::string& advice) {
  if (finding.advice.empty()) finding.advice = advice;
  finding.grade = std::max(finding.grade, grade);
}

// Checks the frame rate, unless the nominal rate is 0. The tolerance is one frame, because the
// capture may begin and end in the middle of a frame.
Finding frame_finding(const char* check, std::uint64_t lost, std::uint64_t frames,
                      double nominal_hz) {
  const double fps = rate(frames), got = static_cast<double>(frames);
  const double expected = nominal_hz * Capture::slot_s;
  Finding out{.check = check,
              .found = format("%.4g frames/s", fps),
              .facts = {{"frames_per_s", fps},
                        {"nominal_frames_per_s", nominal_hz},
                        {"lost_frames", static_cast<double>(lost)}}};
  if (nominal_hz > 0) out.found += format(", expected %.4g", nominal_hz);
  out.found += format(", %" PRIu64 " lost", lost);
  if (got + 1 < slow * expected)
    mark(out, Grade::problem, "frame rate is lower than configured; check the cable and the port");
  else if (nominal_hz > 0 && got - 1 > expected / slow)
    mark(out, Grade::warning,
         "frame rate is higher than configured; check whether the device refused the setting");
  return out;
}

std::string channel_list(const Capture& capture) {
  std::string text;
  for (const auto& [channel, count] : capture.channels)
    text += format("%s%d (%s)", text.empty() ? "" : ", ", channel, rate_text(rate(count)).c_str());
  if (!text.empty()) return "channels with tags: " + text;
  return capture.record.spd_counts.bad_tags > 0 ? "all tags are invalid" : "no channel has tags";
}

// Adds the click rate of each detector zone to the finding, and a warning for each zone without
// clicks.
void add_zones(Finding& finding, const Capture& capture) {
  const std::vector<std::uint32_t>& counts = capture.record.spd;
  const Axis* const axis = find_axis(capture.axes, "spd");
  if (!axis || axis->zones.size() < 2 || counts.empty()) return;
  finding.found += "; zones";
  for (std::size_t z = 0; z < axis->zones.size(); ++z) {
    const auto from = counts.begin() + static_cast<std::ptrdiff_t>(z * axis->count);
    const auto clicks = std::accumulate(from, from + axis->count, std::uint64_t{0});
    finding.found += " " + rate_text(rate(clicks));
    finding.facts.push_back({"zone_" + std::to_string(z) + "_clicks_per_s", rate(clicks)});
    if (clicks == 0) mark(finding, Grade::warning, "zone " + std::to_string(z) + " has no counts");
  }
}

}  // namespace

void Capture::announce(const DeviceInfo& info) {
  if (!intake_) return;
  intake_->slots.announce(info);
  if (info.sensor == Sensor::spd) sends_histograms = !info.axes.empty();
}

void Capture::end() { record = intake_->close({}), axes = intake_->slots.axes(); }

void Capture::on_tags(const TagBlock& block) {
  add(block);
  if (!intake_) return;
  for (const Tag& tag : block.tags)
    if (tag.is_time_tag()) ++channels[tag.channel];
}

void Capture::on_histogram(HistogramFrame frame) {
  longest_exposure_s = std::max(longest_exposure_s, 1e-6 * frame.exposure_us);
  add(frame);
}

void Capture::on_state(Sensor, DeviceState state, const DeviceInfo& info) {
  if (state == DeviceState::streaming) announce(info);
}

void Capture::on_event(Sensor sensor, Severity severity, const std::string& text) {
  auto& list = complaints[sensor];
  if (severity != Severity::info && std::find(list.begin(), list.end(), text) == list.end())
    list.push_back(text);
}

Finding spd_finding(const Capture& capture, const Config& config) {
  const TagCounts& n = capture.record.spd_counts;
  const std::uint64_t clicks = n.in_range + n.out_of_range + n.without_start;
  const std::uint64_t lost = capture.record.sync[Sensor::spd].lost;
  const bool board = capture.sends_histograms;
  const std::string device = board ? "the detector" : "the tagger";
  Finding out{
      .check = "spd",
      .found = board ? format("counts %s, %" PRIu64 " histograms lost",
                              rate_text(rate(clicks)).c_str(), lost)
                     : format("starts %s, clicks %s, %.0f %% of the clicks in the "
                              "histogram, %" PRIu64 " tags and %" PRIu64 " blocks lost",
                              rate_text(rate(n.starts)).c_str(), rate_text(rate(clicks)).c_str(),
                              100 * share(n.in_range, clicks), lost, n.lost_blocks),
      .facts = {{"starts_per_s", rate(n.starts)},
                {"clicks_per_s", rate(clicks)},
                {"share_in_range", share(n.in_range, clicks)},
                {"lost_tags", static_cast<double>(lost)},
                {"lost_blocks", static_cast<double>(n.lost_blocks)}}};
  add_zones(out, capture);
  if (n.starts == 0 && !board)
    mark(out, Grade::problem,
         "no starts on tdc.start_channel = " + std::to_string(config.histogram.start_channel) +
             "; check the laser; " + channel_list(capture));
  if (clicks == 0 && capture.longest_exposure_s > Capture::slot_s)
    mark(out, capture.longest_exposure_s > config.window_s ? Grade::problem : Grade::warning,
         format("doctor reads %.4g s, which is too short for exposures of %.4g s", Capture::slot_s,
                capture.longest_exposure_s));
  else if (clicks == 0 && board)
    mark(out, Grade::problem, "no counts, not even dark counts; check the detector");
  else if (clicks == 0)
    mark(out, Grade::problem,
         "no clicks on tdc.click_channel = " + std::to_string(config.histogram.click_channel) +
             ", not even dark counts; check the detector; " + channel_list(capture));
  if (const std::string question = swap_question(n); !question.empty() && !board)
    mark(out, Grade::warning,
         "clicks are outside the histogram, or there are several clicks per start" + question +
             " If not, set tdc.click_delay_ps (cables, fibres), tdc.first_bin_ps and tdc.bins");
  if (lost + n.lost_blocks + n.overflows > 0)
    mark(out, Grade::warning, device + " or its connection is too slow for these rates");
  if (n.errors + n.bad_tags + n.backwards > 0)
    mark(out, Grade::warning, device + " reports errors or sends invalid data");
  return out;
}

Finding radar_finding(const Capture& capture, const Config& config) {
  const record::FusedRecord& record = capture.record;
  const record::SensorSync& sync = record.sync[Sensor::radar];
  Finding out = frame_finding("radar", sync.lost, sync.arrived, config.nominal_hz()[Sensor::radar]);
  out.facts.emplace_back("bins", static_cast<double>(record.radar.size()));
  const bool bridged = !config.radar.address.empty();
  const radar::RadarProfile cfg = bridged ? radar::RadarProfile{} : parse_profile(config.radar);
  if (sync.lost > 0 && !bridged)
    mark(out, Grade::warning, "check the cable, and that radar.data_baud matches the .cfg");
  if (!record.has(Sensor::radar)) {
    if (!bridged)
      mark(out, Grade::problem,
           format("no frame has a range profile of the %" PRIu32
                  " bins that radar.cfg defines; the radar may be running a different .cfg, or the "
                  "third number of guiMonitor is 0",
                  cfg.bins));
    return out;
  }
  const double peak_m = record.signal.radar_peak_m.value_or(0),
               over_median_db = record.signal.radar_snr_db.value_or(0);
  out.found += format("; %zu bins, peak at %.2f m, %.0f dB over the median", record.radar.size(),
                      peak_m, over_median_db);
  out.facts.emplace_back("peak_m", peak_m);
  out.facts.emplace_back("peak_over_median_db", over_median_db);
  if (!cfg.array.empty()) {
    out.found += format(", heat map of %zu antennas in %" PRIu64 " frames", cfg.array.size(),
                        record.array_frames);
    out.facts.emplace_back("antennas", static_cast<double>(cfg.array.size()));
    out.facts.emplace_back("heat_maps", static_cast<double>(record.array_frames));
    if (record.array_frames == 0)
      mark(out, Grade::problem,
           "no frame contains the heat map that the .cfg defines; check radar.board");
  }
  if (const auto [low, high] = std::ranges::minmax(record.radar); low == high)
    mark(out, Grade::problem, "all bins are equal: the board is not measuring");
  return out;
}

Finding depth_finding(const Capture& capture, const Config& config) {
  const record::SensorSync& sync = capture.record.sync[Sensor::depth];
  const double valid = capture.record.signal.depth_share.value_or(0);
  Finding out = frame_finding("depth", sync.lost, sync.arrived, config.nominal_hz()[Sensor::depth]);
  out.facts.emplace_back("valid_share", valid);
  if (!capture.record.has(Sensor::depth)) {
    mark(out, Grade::problem, "no frame of the expected size received");
    return out;
  }
  out.found += format("; %" PRIu32 " x %" PRIu32 " pixels, %.0f %% of them valid",
                      find_axis(capture.axes, "depth_x")->count,
                      find_axis(capture.axes, "depth_y")->count, 100 * valid);
  if (sync.lost > 0)
    mark(out, Grade::warning, "the USB port or this machine is too slow for the camera");
  if (valid < config.signal.depth_share)
    mark(out, Grade::warning, "almost no pixels are valid; check whether the camera is covered");
  return out;
}

double estimate_record_bytes(const Capture& capture, const Config& config) {
  constexpr std::uint32_t usual_width = 640, usual_height = 480;
  std::vector<Axis> axes = capture.axes;
  const auto expect = [&](const Axis& axis) {
    if (!find_axis(axes, axis.name)) axes.push_back(axis);
  };
  const SensorSet sensors = config.configured();
  if (sensors.contains(Sensor::spd)) expect(tdc::Histogram(config.histogram).axis());
  if (sensors.contains(Sensor::radar) && config.radar.address.empty()) {
    const radar::RadarProfile cfg = parse_profile(config.radar);
    expect(radar_axis(cfg));
    if (!cfg.array.empty()) expect(record::array_axis(radar_axis(cfg), cfg.array.size()));
  }
  if (sensors.contains(Sensor::depth)) {
    expect(tangent_axis("depth_x", config.depth.width ? config.depth.width : usual_width, 0, 1));
    expect(tangent_axis("depth_y", config.depth.height ? config.depth.height : usual_height, 0, 1));
  }
  return record::record_bytes(axes, capture.record);
}

}  // namespace echofuse::acquire
