// SPDX-License-Identifier: MIT
#include "acquire/intake/sample_check.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <numbers>
#include <utility>

#include "acquire/measurement/detector.hpp"
#include "drivers/core/median.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::uint64_t enough_exposures = 10;
constexpr double enough_s = 1, overlap = 1.2, shortest_share = 2e-3;
constexpr std::size_t enough_profiles = 20, enough_maps = 10;
constexpr double nearest_m = 0.05, farthest_m = 300, min_median_mm = 20;
constexpr double widest = 3;  // tangent of 71.6 degrees

std::string digits(double value) { return format("%.4g", value); }

// Returns true if the values may be in dB: some are negative, or the largest is less than 6 times
// the smallest. Linear power spans a larger ratio, and is negative only if noise was subtracted.
bool looks_like_db(const std::vector<float>& power) {
  constexpr float min_ratio = 6;
  const auto [low, high] = std::ranges::minmax(power);
  return low < high && (low < 0 || high < min_ratio * low);
}

}  // namespace

std::string fault_of_depths(double median_mm) {
  if (median_mm >= min_median_mm) return {};
  return "its median is " + std::to_string(std::lround(median_mm)) + " mm; expected depths in ";
}

void SampleCheck::once(const char* fault, Sensor sensor, const std::string& text) {
  if (reported_.emplace(fault, sensor).second) report_(sensor, text);
}

bool SampleCheck::take(HistogramFrame& frame) {
  check_clock(Sensor::spd, frame.device_time_us, frame.received);
  if (!take(frame.counts, 1e-6 * frame.exposure_us)) {
    lost_ += frame.lost_before + 1;
    return false;
  }
  frame.lost_before += std::exchange(lost_, 0);
  check_exposures(frame);
  return true;
}

bool SampleCheck::take(const std::vector<std::uint32_t>& counts, double exposure_s) {
  const auto highest = std::ranges::max_element(counts);
  if (highest != counts.end() && (*highest > record::max_clicks_per_s * exposure_s ||
                                  *highest == std::numeric_limits<std::uint32_t>::max())) {
    once("impossible", Sensor::spd,
         "bin " + std::to_string(highest - counts.begin()) + " contains " +
             std::to_string(*highest) + " counts in an exposure of " + digits(exposure_s) +
             " s, more than a detector can send; such exposures are dropped and counted as lost");
    return false;
  }
  const bool rises = last_counts_.size() == counts.size() &&
                     std::ranges::equal(last_counts_, counts, std::ranges::less_equal()) &&
                     last_counts_ != counts;
  last_counts_ = counts;
  rises_ = rises ? rises_ + 1 : 0;
  if (rises_ >= enough_exposures)
    once("falls", Sensor::spd,
         "counts fall in no bin over ten exposures; is the histogram cleared after each exposure?");
  return true;
}

// Compares the exposures with the time between their ends, by the host's or the device's clock,
// whichever is longer. Buffered histograms arrive faster than they were measured.
void SampleCheck::check_exposures(const HistogramFrame& frame) {
  const double exposure_s = 1e-6 * frame.exposure_us;
  if (exposure_s > window_s_)
    once("long", Sensor::spd,
         "exposures of " + digits(exposure_s) + " s do not fit slots of " + digits(window_s_) +
             " s; use shorter exposures or longer slots (run.window_s)");
  if (!first_ || frame.device_time_us < first_->device_time_us) {
    first_ = {frame.received, last_us_ = frame.device_time_us};
    exposures_ = exposed_us_ = brief_ = 0;
    return;
  }
  const auto step_us = static_cast<double>(frame.device_time_us - last_us_);
  last_us_ = frame.device_time_us;
  brief_ += frame.exposure_us < shortest_share * step_us;
  ++exposures_, exposed_us_ += frame.exposure_us;
  const double passed_s =
      std::max(seconds(frame.received - first_->received),
               1e-6 * static_cast<double>(frame.device_time_us - first_->device_time_us));
  if (exposures_ < enough_exposures || passed_s < enough_s) return;
  const double times = 1e-6 * static_cast<double>(exposed_us_) / passed_s;
  if (2 * brief_ > exposures_)
    once("short", Sensor::spd,
         "most exposures are shorter than 0.2 % of the time between their ends; are the exposure "
         "times in us?");
  if (times > overlap)
    once("overlap", Sensor::spd,
         "exposures add up to " + digits(std::round(10 * times) / 10) +
             " times the time between them: are they sliding windows, or is the histogram not "
             "cleared?");
  first_ = {frame.received, frame.device_time_us}, exposures_ = exposed_us_ = brief_ = 0;
}

void SampleCheck::take(RadarFrame& frame) {
  check_clock(Sensor::radar, frame.time_cpu_cycles, frame.received);
  if (frame.power.empty()) return;
  if (std::ranges::all_of(frame.power, [](float p) { return p == 0; })) {
    frame.power.clear(), frame.array.clear();
    return once("zeros", Sensor::radar,
                "all bins of a range profile are zero; such profiles are not used");
  }
  if (profiles_ == enough_profiles) return;
  like_db_ += looks_like_db(frame.power);
  if (++profiles_ == enough_profiles) finish();
}

void SampleCheck::finish() {
  if (2 * like_db_ > profiles_)
    once("db", Sensor::radar,
         "profiles have negative values or a max/min ratio below 6: are they in dB? Expected "
         "linear power, 10^(dB/10)");
}

// Reports the rate of the device clock. ClockFit then uses receipt times.
void SampleCheck::check_clock(Sensor sensor, std::uint64_t ticks, HostTime received) {
  if (const std::string rate = clocks_[sensor].add(ticks, received); !rate.empty())
    once("clock", sensor,
         "the device clock " + rate +
             "; check that its times are in us. Receipt times are used instead");
}

void SampleCheck::take(const DepthFrame& frame) {
  check_clock(Sensor::depth, frame.device_time_us, frame.received);
  if (maps_ == enough_maps) return;
  ++maps_;
  std::vector<std::uint16_t> returns;
  std::ranges::copy_if(frame.depth_mm, std::back_inserter(returns), [](auto z) { return z > 0; });
  if (returns.empty()) return;
  if (const std::string fault = fault_of_depths(median(std::move(returns))); !fault.empty())
    once("depth", Sensor::depth, "depth map: " + fault + "millimetres");
}

void SampleCheck::take(const Axis& axis) {
  const bool spd = axis.name == "spd";
  const auto check_end = [&](double zero) {
    const double end_m = (axis.at(axis.count) - zero) / (spd ? ps_per_m : 1);
    if (end_m < nearest_m || end_m > farthest_m)
      once("axis", spd ? Sensor::spd : Sensor::radar,
           (spd ? "the histogram ends at " : "the range profile ends at ") + digits(end_m) +
               " m; " +
               (!spd        ? "is its range step in metres?"
                : zero == 0 ? "are its bins in ps?"
                            : "are its bins and zero_ps in ps?"));
  };
  double tangent = 0;
  if (axis.name.starts_with("depth_")) tangent = std::abs(axis.start);
  for (const Zone& zone : axis.zones) {
    if (spd || axis.name == "radar") check_end(zone.zero_ps);
    if (zone.has_direction()) tangent = std::max({tangent, std::abs(zone.x), std::abs(zone.y)});
    const auto same = [&](const Zone& z) { return z.x == zone.x && z.y == zone.y; };
    if (std::ranges::count_if(axis.zones, same) > 1)
      once("zones", Sensor::spd,
           "several zones have the direction x = " + digits(zone.x) + ", y = " + digits(zone.y) +
               "; check the list of zones");
  }
  if (tangent > widest)
    once("tangent", spd ? Sensor::spd : Sensor::depth,
         "the field of view contains the tangent " + digits(tangent) + ", or " +
             digits(std::atan(tangent) * 180 / std::numbers::pi) +
             " degrees from the optical axis; are the tangents in degrees?");
}

}  // namespace echofuse::acquire
