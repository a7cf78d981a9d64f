// SPDX-License-Identifier: MIT
#include "recon/live/tally.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "recon/live/message.hpp"
#include "recon/live/peak_fit.hpp"
#include "recon/live/pictures.hpp"

namespace echofuse::view {
namespace {

using Json = nlohmann::json;

Json fit_json(const std::optional<PeakFit>& fit) {
  if (!fit) return nullptr;
  return {{"centre_m", number(fit->centre)},
          {"error_m", number(fit->centre_error)},
          {"fwhm_m", number(fit->fwhm)}};
}

// Converts an axis of bins to an axis of bin centres in metres.
Axis centres_m(Axis axis) {
  axis.start = (axis.start + axis.step / 2) / ps_per_m, axis.step /= ps_per_m;
  return axis;
}

}  // namespace

void Tally::add(const record::FusedRecord& r, const std::vector<Axis>& axes, int sign) {
  if (r.has(Sensor::spd)) {
    const std::vector<float> clicks = clicks_of(r, axes);
    clicks_.resize(clicks.size());
    for (std::size_t i = 0; i < clicks.size(); ++i) clicks_[i] += sign * double{clicks[i]};
    const TagCounts& c = r.spd_counts;
    const auto placed = static_cast<double>(c.in_range + c.out_of_range);
    const double a_pulse = r.clicks_per_pulse();
    spd_records_ += sign;
    slots_s_ += sign * seconds(r.slot_end - r.slot_start);
    all_clicks_ += sign * (placed + static_cast<double>(c.without_start));
    starts_ += sign * static_cast<double>(c.starts);
    if (a_pulse > 0 || placed == 0)
      pulses_ += sign * (a_pulse > 0 ? placed / a_pulse : static_cast<double>(c.starts));
    else
      unknown_pulses_ += sign;
  }
  if (!r.has(Sensor::radar)) return;
  power_.resize(r.radar.size());
  for (std::size_t i = 0; i < r.radar.size(); ++i) power_[i] += sign * double{r.radar[i]};
  radar_records_ += sign;
}

std::vector<float> Tally::profile_db(const std::vector<Axis>& axes) const {
  if (radar_records_ < 1 || !find(axes, "radar")) return {};
  std::vector<float> out;
  for (const double power : power_)
    out.push_back(static_cast<float>(10 * std::log10(std::max(power / radar_records_, 1e-12))));
  return out;
}

Json Tally::rates(const Axis& axis, double laser_hz) const {
  if (spd_records_ < 1 || slots_s_ <= 0) return nullptr;
  const std::size_t bins = bins_before_return(clicks_);
  double dark = 0;
  for (std::size_t i = 0; i < bins; ++i) dark += clicks_[i];
  const double pulses = laser_hz > 0 ? laser_hz * slots_s_ : unknown_pulses_ > 0 ? 0 : pulses_;
  const double looked_s = pulses * static_cast<double>(bins) * axis.step * 1e-12;
  return {{"sync_hz", starts_ > 0 ? number(starts_ / slots_s_) : Json()},
          {"pulse_hz", pulses > 0 ? number(pulses / slots_s_) : Json()},
          {"click_hz", all_clicks_ / slots_s_},
          {"dark_hz", looked_s > 0 ? number(dark / looked_s) : Json()},
          {"clicks_per_pulse", pulses > 0 ? number(all_clicks_ / pulses) : Json()}};
}

Json Tally::numbers(const std::vector<Axis>& axes, double laser_hz, const FitRange& range) const {
  const Axis *spd = find(axes, "spd"), *radar = find(axes, "radar");
  Json out{{"rates", nullptr},
           {"spd_records", spd_records_},
           {"fits", {{"spd", nullptr}, {"radar", nullptr}}}};
  if (spd && spd_records_ > 0) {
    out["rates"] = rates(*spd, laser_hz);
    out["fits"]["spd"] =
        fit_json(fit_peak(clicks_, centres_m(*spd), range.from_m, range.to_m, true));
  }
  if (radar && radar_records_ > 0)
    out["fits"]["radar"] = fit_json(fit_peak(power_, *radar, range.from_m, range.to_m, false));
  return out;
}

}  // namespace echofuse::view
