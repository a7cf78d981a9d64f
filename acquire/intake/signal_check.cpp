// SPDX-License-Identifier: MIT
#include "acquire/intake/signal_check.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "acquire/measurement/radar_leakage.hpp"
#include "acquire/record/fused_record.hpp"
#include "drivers/core/median.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {

using record::ok_verdict;
using record::Verdict;
using record::VerdictKind;

namespace {

constexpr double reference_s = 60;
constexpr std::size_t min_records = 5;

// Returns true if the counts have no peak. The limit for the sum of 5 adjacent bins is its mean
// plus five standard deviations plus five clicks. The five clicks allow for the long tail of the
// Poisson distribution at low counts.
bool is_even(const std::vector<std::uint32_t>& counts) {
  constexpr std::size_t bins = 5;
  if (counts.size() <= bins) return false;
  const double mean = std::accumulate(counts.begin(), counts.end(), 0.0) * bins /
                      static_cast<double>(counts.size());
  const double chance = mean + 5 * std::sqrt(mean) + 5;
  double sum = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    sum += counts[i];
    if (i >= bins) sum -= counts[i - bins];
    if (sum > chance) return false;
  }
  return true;
}

// Returns true if `a` and `b` differ only by rounding, i.e. by less than 1e-5 of the maximum.
bool same_profile(const std::vector<float>& a, const std::vector<float>& b) {
  const float rounding = a.empty() ? 0 : 1e-5F * std::abs(std::ranges::max(a));
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [&](float x, float y) { return std::abs(x - y) <= rounding; });
}

// Returns true if starts without a click may be missing because of a conditional filter in the
// tagger or because of T3 mode.
bool may_be_filtered(const record::FusedRecord& r) {
  const TagCounts& c = r.spd_counts;
  const auto clicks = static_cast<double>(c.in_range + c.out_of_range);
  const auto starts = static_cast<double>(c.starts);
  if (starts >= 2 * clicks) return false;
  constexpr double max_share = 0.5;  // maximum fraction of pulses that a filter passes
  const auto& a_pulse = r.signal.clicks_per_pulse;
  return !a_pulse || *a_pulse * starts < max_share * clicks;
}

Verdict still(const char* parts) {
  return {VerdictKind::stands_still, format("identical to the previous record in every %s", parts)};
}

}  // namespace

SignalCheck::SignalCheck(const SignalLimits& limits, double window_s, PerSensor<double> nominal_hz,
                         double far_m)
    : limits_(limits),
      nominal_hz_(nominal_hz),
      far_mm_(far_m * 1000),
      reference_records_(
          std::max(min_records, static_cast<std::size_t>(std::ceil(reference_s / window_s)))) {}

std::optional<double> SignalCheck::Reference::add(double strength, std::size_t at_most) {
  if (values_.size() < at_most) {
    values_.push_back(strength);
    if (values_.size() >= min_records) median_ = median(values_);
  }
  return median_;
}

Verdict SignalCheck::compare_with_reference(Sensor sensor, double strength, const char* what) {
  const auto usual = references_[sensor].add(strength, reference_records_);
  if (!usual || strength >= limits_.weak_share * *usual) return ok_verdict;
  return {VerdictKind::weak, format("%s is %.2g times its median in the first minute of the run",
                                    what, strength / *usual)};
}

Verdict SignalCheck::assess_spd(record::FusedRecord& r, const Axis& axis) {
  bool even = true;  // true if no zone has a peak
  // Number of clicks above the background, number of all clicks, and number of clicks in the
  // brightest zone.
  double clicks = 0, all = 0, brightest = 0;
  for (auto from = r.spd.begin(); from < r.spd.end(); from += axis.count) {
    const std::vector<std::uint32_t> zone(from, from + axis.count);
    const double sum = std::accumulate(zone.begin(), zone.end(), 0.0);
    clicks += sum - static_cast<double>(median(zone)) * axis.count;
    all += sum, brightest = std::max(brightest, sum);
    even = even && is_even(zone);
  }
  clicks = std::max(0.0, clicks);
  const auto top = (std::max_element(r.spd.begin(), r.spd.end()) - r.spd.begin()) % axis.count;
  r.signal.spd_clicks = clicks;
  if (!even)
    r.signal.spd_peak_m = (axis.start + (static_cast<double>(top) + 0.5) * axis.step) / ps_per_m;
  const Verdict compared = compare_with_reference(Sensor::spd, clicks, "light level");
  const bool repeats = r.spd == last_spd_ && r.spd_counts.in_range > 0;
  last_spd_ = r.spd;
  if (repeats) return still("bin");
  const double a_pulse = r.signal.clicks_per_pulse.value_or(0) * (all > 0 ? brightest / all : 1);
  if (limits_.clicks_per_pulse > 0 && a_pulse > limits_.clicks_per_pulse)
    return {VerdictKind::saturated,
            format("%.3g clicks per laser pulse%s (limit %.3g)", a_pulse,
                   brightest < all ? " in the brightest zone" : "", limits_.clicks_per_pulse) +
                swap_question(r.spd_counts)};
  const TagCounts& c = r.spd_counts;
  if (even && c.out_of_range > c.in_range)
    return {VerdictKind::no_peak,
            format("no bins clearly exceed the mean, and %.0f %% of the clicks are outside the "
                   "histogram (%.2f to %.2f m)",
                   100.0 * static_cast<double>(c.out_of_range) /
                       static_cast<double>(c.in_range + c.out_of_range),
                   axis.start / ps_per_m, axis.at(axis.count) / ps_per_m) +
                swap_question(c)};
  if (even) return {VerdictKind::no_peak, "no bins clearly exceed the mean"};
  if (clicks < limits_.spd_clicks)
    return {VerdictKind::weak,
            format("%.0f clicks above the background (minimum %.0f)", clicks, limits_.spd_clicks)};
  return compared;
}

Verdict SignalCheck::assess_radar(record::FusedRecord& r, const Axis& axis) {
  const std::vector<double> power(r.radar.begin(), r.radar.end());
  const std::size_t leakage = record::leakage_bins(axis);
  if (power.size() <= leakage + 2)
    return {VerdictKind::not_assessed,
            format("only %zu range bins beyond the leakage below %.1f m (minimum 3)",
                   power.size() - std::min(leakage, power.size()),
                   axis.at(static_cast<double>(leakage)))};
  const double floor = median(power);
  const auto first = power.begin() + static_cast<std::ptrdiff_t>(leakage);
  const auto top = static_cast<std::size_t>(std::max_element(first, power.end()) - power.begin());
  // After noise subtraction, the median may be 0 or negative. The peak-to-median ratio is then
  // infinite and is not stored.
  const double snr_db = power[top] <= 0 ? 0 : 10 * std::log10(power[top] / std::max(floor, 0.0));
  double strength = 0;
  for (auto p = first; p != power.end(); ++p) strength += std::max(0.0, *p - floor);
  if (std::isfinite(snr_db)) r.signal.radar_snr_db = snr_db;
  r.signal.radar_peak_m = axis.start + static_cast<double>(top) * axis.step;
  const Verdict compared = compare_with_reference(Sensor::radar, strength, "echo power");
  const bool repeats = same_profile(r.radar, last_radar_);
  last_radar_ = r.radar;
  if (repeats) return still("bin");
  if (snr_db < limits_.radar_snr_db)
    return {VerdictKind::no_peak,
            format("%.1f dB above the median bin (minimum %.1f dB)", snr_db, limits_.radar_snr_db)};
  // Two equal bins at the top of an average over several frames indicate that every frame is
  // clipped. The verdict requires this in two successive records, because a frozen frame may have
  // equal bins by chance; the second record then reveals the freeze.
  const bool averaged = r.sync[Sensor::radar].used > 1;
  const bool flat = averaged && (r.radar[top] == r.radar[top - 1] ||
                                 (top + 1 < r.radar.size() && r.radar[top] == r.radar[top + 1]));
  if (std::exchange(radar_was_flat_, flat) && flat)
    return {VerdictKind::saturated,
            format("the lobe at %.2f m is clipped", *r.signal.radar_peak_m)};
  return compared;
}

Verdict SignalCheck::assess_depth(record::FusedRecord& r) {
  const auto& mm = r.depth_mm;
  const auto returns = std::ranges::count_if(mm, [&](auto z) { return z > 0 && z <= far_mm_; });
  const double share = static_cast<double>(returns) / static_cast<double>(mm.size());
  r.signal.depth_share = share;
  const Verdict compared =
      compare_with_reference(Sensor::depth, share, "fraction of pixels with a return");
  const bool repeats = mm == last_depth_ && share > 0;
  last_depth_ = mm;
  if (repeats) return still("pixel");
  if (share < limits_.depth_share)
    return {VerdictKind::weak, format("%.2f %% of the pixels have a return (minimum %.2g %%)",
                                      100 * share, 100 * limits_.depth_share)};
  return compared;
}

// Returns the verdict "lossy" if the received share of the samples sent is below the limit. The
// number sent is the number received and lost, or the nominal rate times the duration if that is
// larger. If the nominal frame rate is unknown, the median number of frames sent per slot in the
// first minute is used.
Verdict SignalCheck::assess_losses(const record::FusedRecord& r, Sensor sensor,
                                   std::optional<HostTime> end) {
  const record::SensorSync& sync = r.sync[sensor];
  const bool spd = sensor == Sensor::spd;
  const double slot_s = seconds(r.slot_end - r.slot_start);
  const auto at_nominal_rate = [&](double expected) {
    const bool ends = end && *end < r.slot_end;
    return ends ? expected * std::max(0.0, seconds(*end - r.slot_start)) / slot_s : expected;
  };
  const auto verdict_of = [&](std::uint64_t received, double sent, const char* unit) -> Verdict {
    const auto arrived = static_cast<double>(received);
    // A deficit of one frame is tolerated, because a frame may fall into the adjacent slot.
    if (received == 0 || arrived >= limits_.lossy_share * sent || sent - arrived < 2)
      return ok_verdict;
    return {VerdictKind::lossy,
            format("%.0f %% of the %.0f %s received", 100 * arrived / sent, sent, unit)};
  };
  const double sent = static_cast<double>(sync.arrived + sync.lost);
  const bool tags = spd && r.spd_counts.tags == sync.arrived;
  Verdict out = verdict_of(sync.arrived, sent, tags ? "tags" : spd ? "histograms" : "frames");
  if (spd) {
    if (out.ok() && !may_be_filtered(r))
      out = verdict_of(r.spd_counts.starts, at_nominal_rate(nominal_hz_[sensor] * slot_s),
                       "expected start pulses");
    return out;
  }
  const std::uint64_t used = sensor == Sensor::radar ? sync.used : sync.arrived;
  double expected = nominal_hz_[sensor] * slot_s;
  if (expected == 0 && sync.arrived > 0)
    expected = frames_[sensor].add(sent, reference_records_).value_or(sent);
  return out.ok() ? verdict_of(used, at_nominal_rate(expected), "expected frames") : out;
}

void SignalCheck::assess(record::FusedRecord& record, std::span<const Axis> axes,
                         const RecordingEnds& ends) {
  PerSensor<Verdict> found{ok_verdict, ok_verdict, ok_verdict};
  if (const Axis* const a = find_axis(axes, "spd"); a && record.has(Sensor::spd))
    found[Sensor::spd] = assess_spd(record, *a);
  if (const Axis* const a = find_axis(axes, "radar"); a && record.has(Sensor::radar))
    found[Sensor::radar] = assess_radar(record, *a);
  if (record.has(Sensor::depth)) found[Sensor::depth] = assess_depth(record);
  for (const Sensor s : all_sensors) {
    if (!record.has(s)) continue;
    Verdict& verdict = record.sync[s].verdict;
    // An imported record keeps the losses of the record that it was copied from.
    const Verdict losses = assess_losses(record, s, ends[s]);
    found[s].add(losses.ok() && verdict.kind == VerdictKind::lossy ? verdict : losses);
    if (!found[s].ok()) verdict = found[s];
  }
}

std::string swap_question(const TagCounts& c) {
  constexpr double nearly_all = 0.98, clicks_a_start = 4;
  const auto inside = static_cast<double>(c.in_range),
             outside = static_cast<double>(c.out_of_range);
  const bool outside_all = outside > 0 && outside >= nearly_all * (inside + outside);
  const bool many =
      c.starts > 0 && inside + outside > clicks_a_start * static_cast<double>(c.starts);
  return outside_all || many ? ": are the start and click channels swapped?" : "";
}

}  // namespace echofuse::acquire
