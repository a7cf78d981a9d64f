// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <utility>

#include "acquire/doctor/doctor.hpp"
#include "acquire/intake/signal_check.hpp"
#include "acquire/record/deflate.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

constexpr double slow = 0.9;  // lowest accepted fraction of the nominal rate

double rate(std::uint64_t count, double time_s) { return static_cast<double>(count) / time_s; }

std::string hertz(double value) {
  constexpr const char* units[] = {"Hz", "kHz", "MHz"};
  std::size_t unit = 0;
  for (; value >= 1000 && unit + 1 < std::size(units); ++unit) value /= 1000;
  return format("%.4g %s", value, units[unit]);
}

double share(std::uint64_t part, std::uint64_t whole) {
  return whole ? static_cast<double>(part) / static_cast<double>(whole) : 0;
}

// Sets the advice for the first fault. Further faults can only raise the grade.
void mark(Finding& finding, Grade grade, const std::string& advice) {
  if (finding.advice.empty()) finding.advice = advice;
  finding.grade = std::max(finding.grade, grade);
}

// Checks a frame rate. The tolerance is one frame, because the capture may begin and end in the
// middle of a frame.
void check_rate(Finding& finding, std::uint64_t frames, double nominal_hz, double time_s) {
  const double expected = nominal_hz * time_s, got = static_cast<double>(frames);
  if (got + 1 < slow * expected)
    mark(finding, Grade::problem,
         "frame rate is lower than configured; check the cable and the port");
  else if (got - 1 > expected / slow)
    mark(finding, Grade::warning,
         "frame rate is higher than configured; check whether the device refused the setting");
}

std::string channel_list(const Capture& capture, double time_s) {
  std::string text;
  for (const auto& [channel, count] : capture.channels)
    text +=
        format("%s%d (%s)", text.empty() ? "" : ", ", channel, hertz(rate(count, time_s)).c_str());
  return text.empty() ? "no channel has tags" : "channels with tags: " + text;
}

// Adds the click rate of each detector zone to the finding, and a warning for each zone without
// clicks.
void add_zones(Finding& finding, const std::vector<std::uint64_t>& clicks, double time_s) {
  if (clicks.size() < 2) return;
  finding.found += "; zones";
  for (std::size_t z = 0; z < clicks.size(); ++z) {
    finding.found += " " + hertz(rate(clicks[z], time_s));
    finding.facts.push_back(
        {"zone_" + std::to_string(z) + "_clicks_per_s", rate(clicks[z], time_s)});
    if (clicks[z] == 0)
      mark(finding, Grade::warning, "zone " + std::to_string(z) + " has no counts");
  }
}

}  // namespace

void Capture::end() {
  histogram_.flush();
  tags = histogram_.tag_counts();
  tags += summed_;
  running_ = false;
}

void Capture::on_tags(const TagBlock& block) {
  if (!running_) return;
  if (block.lost_blocks) histogram_.forget_start();
  histogram_.add(block.tags);
  lost_blocks += block.lost_blocks;
  lost_tags += block.lost_items;
  for (const Tag& tag : block.tags)
    if (tag.type == TagType::time_tag) ++channels[tag.channel];
}

void Capture::on_histogram(HistogramFrame frame) {
  if (!running_) return;
  ++histograms;
  lost_blocks += frame.lost_before;
  histogram_counts = frame.counts.size();
  zone_clicks.resize(frame.zones);
  for (std::size_t i = 0; i < histogram_counts; ++i)
    zone_clicks[i * frame.zones / histogram_counts] += frame.counts[i];
  summed_ += {.starts = frame.pulses, .in_range = frame.clicks()};
}

void Capture::on_radar(RadarFrame frame) {
  if (!running_) return;
  ++radar_frames;
  radar_lost += frame.lost_before;
  arrays += !frame.array.empty();
  if (frame.power.empty()) return;
  ++profiles;
  profile = std::move(frame.power);
}

void Capture::on_depth(DepthFrame frame) {
  if (!running_) return;
  ++depth_frames;
  depth_lost += frame.lost_before;
  pixels += frame.depth_mm.size();
  for (const std::uint16_t z : frame.depth_mm) valid_pixels += z != 0 ? 1u : 0u;
  depth = std::move(frame);
}

void Capture::on_event(Sensor sensor, Severity severity, const std::string& text) {
  auto& list = complaints[sensor];
  if (severity != Severity::info && std::find(list.begin(), list.end(), text) == list.end())
    list.push_back(text);
}

Finding spd_finding(const Capture& capture, const Config& config, double time_s) {
  const TagCounts& n = capture.tags;
  const std::uint64_t clicks = n.in_range + n.out_of_range + n.without_start;
  const std::uint64_t lost = capture.lost_tags + n.missed;
  Finding out{
      .check = "spd",
      .found = format("starts %s, clicks %s, %.0f %% of the clicks in the histogram, "
                      "%" PRIu64 " tags and %" PRIu64 " blocks lost",
                      hertz(rate(n.starts, time_s)).c_str(), hertz(rate(clicks, time_s)).c_str(),
                      100 * share(n.in_range, clicks), lost, capture.lost_blocks),
      .facts = {{"starts_per_s", rate(n.starts, time_s)},
                {"clicks_per_s", rate(clicks, time_s)},
                {"share_in_range", share(n.in_range, clicks)},
                {"lost_tags", static_cast<double>(lost)},
                {"lost_blocks", static_cast<double>(capture.lost_blocks)}}};
  add_zones(out, capture.zone_clicks, time_s);
  if (n.starts == 0 && capture.histograms == 0)
    mark(out, Grade::problem,
         "no starts on tdc.start_channel = " + std::to_string(config.histogram.start_channel) +
             "; check the laser; " + channel_list(capture, time_s));
  if (clicks == 0 && capture.histograms > 0)
    mark(out, Grade::problem, "no counts, not even dark counts; check the detector");
  else if (clicks == 0)
    mark(out, Grade::problem,
         "no clicks on tdc.click_channel = " + std::to_string(config.histogram.click_channel) +
             ", not even dark counts; check the detector; " + channel_list(capture, time_s));
  if (const std::string question = swap_question(n); !question.empty())
    mark(out, Grade::warning,
         "clicks are outside the histogram, or there are several clicks per start" + question +
             " If not, set tdc.click_delay_ps (cables, fibres), tdc.first_bin_ps and tdc.bins");
  if (lost + capture.lost_blocks + n.overflows > 0)
    mark(out, Grade::warning, "the tagger or its connection is too slow for these rates");
  if (n.errors + n.bad_tags + n.backwards > 0)
    mark(out, Grade::warning, "the tagger reports errors or sends invalid tags");
  return out;
}

Finding radar_finding(const Capture& capture, const Config& config, double time_s) {
  if (!config.radar.address.empty())
    return {.check = "radar",
            .found = format("%.4g range profiles/s with %zu bins, %" PRIu64 " lost",
                            rate(capture.radar_frames, time_s), capture.profile.size(),
                            capture.radar_lost),
            .facts = {{"frames_per_s", rate(capture.radar_frames, time_s)},
                      {"lost_frames", static_cast<double>(capture.radar_lost)},
                      {"bins", static_cast<double>(capture.profile.size())}}};
  const radar::RadarProfile cfg = parse_profile(config.radar);
  const double nominal_hz = 1 / cfg.frame_period_s;
  const double fps = rate(capture.radar_frames, time_s);
  Finding out{.check = "radar",
              .found = format("%.4g frames/s, expected %.4g, %" PRIu64 " lost", fps, nominal_hz,
                              capture.radar_lost),
              .facts = {{"frames_per_s", fps},
                        {"nominal_frames_per_s", nominal_hz},
                        {"lost_frames", static_cast<double>(capture.radar_lost)},
                        {"bins", static_cast<double>(capture.profile.size())}}};
  check_rate(out, capture.radar_frames, nominal_hz, time_s);
  if (capture.radar_lost > 0)
    mark(out, Grade::warning, "check the cable, and that radar.data_baud matches the .cfg");
  if (capture.profiles == 0) {
    mark(out, Grade::problem,
         "no frame has a range profile; set the third number of guiMonitor in radar.cfg to 1");
    return out;
  }
  if (capture.profile.size() != cfg.bins) {
    mark(out, Grade::problem,
         format("the profiles have %zu bins, but radar.cfg defines %" PRIu32
                "; the radar may be running a different .cfg",
                capture.profile.size(), cfg.bins));
    return out;
  }
  auto sorted = capture.profile;
  std::sort(sorted.begin(), sorted.end());
  const auto peak = std::max_element(capture.profile.begin(), capture.profile.end());
  const double over_median_db =
      10 * std::log10(double{sorted.back()} / double{sorted[sorted.size() / 2]});
  const double peak_m = static_cast<double>(peak - capture.profile.begin()) * cfg.range_step_m;
  out.found += format("; %" PRIu32 " bins, peak at %.2f m, %.0f dB over the median", cfg.bins,
                      peak_m, over_median_db);
  out.facts.emplace_back("peak_m", peak_m);
  out.facts.emplace_back("peak_over_median_db", over_median_db);
  if (!cfg.array.empty()) {
    out.found += format(", heat map of %zu antennas in %" PRIu64 " frames", cfg.array.size(),
                        capture.arrays);
    out.facts.emplace_back("antennas", static_cast<double>(cfg.array.size()));
    out.facts.emplace_back("heat_maps", static_cast<double>(capture.arrays));
    if (capture.arrays == 0)
      mark(out, Grade::problem,
           "no frame contains the heat map that the .cfg defines; check radar.board");
  }
  if (sorted.front() == sorted.back())
    mark(out, Grade::problem, "all bins are equal: the board is not measuring");
  return out;
}

Finding depth_finding(const Capture& capture, const Config& config, double time_s) {
  const double fps = rate(capture.depth_frames, time_s);
  const double valid = share(capture.valid_pixels, capture.pixels);
  Finding out{.check = "depth",
              .found = format("%.4g frames/s", fps),
              .facts = {{"frames_per_s", fps},
                        {"nominal_frames_per_s", static_cast<double>(config.depth.fps)},
                        {"lost_frames", static_cast<double>(capture.depth_lost)},
                        {"valid_share", valid}}};
  if (config.depth.fps > 0) {
    out.found += format(", expected %" PRIu32, config.depth.fps);
    check_rate(out, capture.depth_frames, config.depth.fps, time_s);
  }
  out.found += format(", %" PRIu64 " lost", capture.depth_lost);
  if (!capture.depth) {
    mark(out, Grade::problem, "no frame received");
    return out;
  }
  out.found += format("; %" PRIu32 " x %" PRIu32 " pixels, %.0f %% of them valid",
                      capture.depth->width, capture.depth->height, 100 * valid);
  if (capture.depth_lost > 0)
    mark(out, Grade::warning, "the USB port or this machine is too slow for the camera");
  if (valid < config.signal.depth_share)
    mark(out, Grade::warning, "almost no pixels are valid; check whether the camera is covered");
  return out;
}

double estimate_record_bytes(const Capture& capture, const Config& config) {
  constexpr std::uint32_t usual_width = 640, usual_height = 480;
  const SensorSet sensors = config.configured();
  double bytes = 0;
  if (sensors.contains(Sensor::spd))
    bytes += 4.0 * (capture.histograms > 0 ? static_cast<double>(capture.histogram_counts)
                                           : static_cast<double>(config.histogram.bins));
  if (sensors.contains(Sensor::radar) && !config.radar.address.empty()) {
    bytes += 4.0 * static_cast<double>(capture.profile.size());
  } else if (sensors.contains(Sensor::radar)) {
    const radar::RadarProfile cfg = parse_profile(config.radar);
    bytes += 4.0 * cfg.bins;
    if (!cfg.array.empty())
      bytes += record::array_bytes(record::array_axis(radar_axis(cfg), cfg.array.size()));
  }
  if (!sensors.contains(Sensor::depth)) return bytes;
  if (const auto& d = capture.depth)
    return bytes +
           static_cast<double>(record::deflated(as_bytes(d->depth_mm), record::depth_level).size());
  return bytes + 2.0 * (config.depth.width ? config.depth.width : usual_width) *
                     (config.depth.height ? config.depth.height : usual_height);
}

}  // namespace echofuse::acquire
