// SPDX-License-Identifier: MIT
#include "sim/fit/quantities.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace echofuse::sim {
namespace {

double clothes(const Conditions& c) { return (c.albedo_min + c.albedo_max) / 2; }

// Ratios and products that a run may tell though their factors it does not.
struct Derived {
  const char *name, *meaning;
  double (*of)(const Conditions&);
};
const Derived derived[] = {
    {"plate_to_body_light", "albedo of the letter, of the clothes' mean",
     [](const Conditions& c) { return c.letter_albedo / clothes(c); }},
    {"plate_to_body_radar", "the same of the radar's reflectivity",
     [](const Conditions& c) {
       return c.radar_plate * c.letter_albedo /
              (0.5 + c.radar_follows_albedo * (clothes(c) - 0.5)) / c.radar_cloth;
     }},
    {"blur_fwhm_ps", "response without its tail, with people's motion",
     [](const Conditions& c) {
       return std::hypot(c.irf_fwhm_ps,
                         2 * std::sqrt(2 * std::log(2.0)) * c.slot_sway_m * ps_per_m);
     }},
    {"irf_tail_delay_ps", "by which the tail delays the mean photon",
     [](const Conditions& c) { return c.irf_tail_ps * c.irf_tail_share; }},
    {"range_bias_m", "radar's ranges against the detector's",
     [](const Conditions& c) { return c.radar_bias_m - c.spd_delay_ps / ps_per_m; }},
};

// Why a run may not tell it. The first that fits: a key, or how it begins.
const std::pair<const char*, const char*> reasons[] = {
    {"radar_cloth", "the unit of the radar's power is not known; the others are of it"},
    {"range_bias_m", "people's centroids are not known to a millimetre; a reflector tells it"},
    {"radar_bias_m", "people's centroids are not known to a millimetre; a reflector tells it"},
    {"spd_delay_ps",
     "depth camera's offset and the response's shape move it, too; a reflector tells it"},
    {"depth_offset_m", "the detector's delay moves the same"},
    {"spd_field", "nobody stands at the edges of the field of view"},
    {"spd_pitch_deg", "light above and below is also the clothes'"},
    {"spd_yaw_deg", "with little fall-off no side is brighter"},
    {"radar_yaw_deg", "with little fall-off no side is brighter"},
    {"slot_sway_m", "it widens the response, as irf_fwhm_ps does"},
    {"irf_fwhm_ps", "people's motion widens it as much (blur_fwhm_ps)"},
    {"irf_tail_delay_ps", "a short tail looks like a wider response"},
    {"irf_tail", "share and time constant of the tail show as their product"},
    {"signal_photons", "brightness is albedo times photons"},
    {"albedo", "brightness is albedo times photons"},
    {"letter_albedo", "only its ratio to the clothes' shows"},
    {"optical_lobe", "a map this coarse does not show the incidence at the edges of a body"},
    {"radar_", "50 cm cells show little of it, or plate, lobe and spread do the same"},
    {"depth_", "the map is a median of many pixels"},
    {"letter_", "the plate has few pixels"},
    {"baseline", "the other errors of the radar's ranges hide it"},
};

}  // namespace

Conditions in_units_of_cloth(Conditions c) {
  const double cloth = c.radar_cloth;
  c.radar_cloth = 1;
  c.radar_skin /= cloth;
  c.radar_plate /= cloth;
  c.radar_leakage /= cloth;
  c.radar_snr_db += 10 * std::log10(cloth);
  return c;
}

std::map<std::string, double> quantities_of(const Conditions& conditions) {
  const Conditions c = in_units_of_cloth(conditions);
  auto all = numbers_of(c);
  for (const Derived& d : derived) all[d.name] = d.of(c);
  return all;
}

std::vector<Estimate> all_quantities(const Twin& prior) {
  std::vector<Estimate> all;
  for (const Range& range : prior.ranges) {
    Estimate e;
    e.name = range.key;
    e.logarithmic = range.logarithmic;
    all.push_back(e);
  }
  for (const Derived& d : derived) {
    Estimate e;
    e.name = d.name;
    e.is_key = false;
    e.logarithmic = e.name.rfind("plate_", 0) == 0 || e.name.rfind("blur_", 0) == 0;
    all.push_back(e);
  }
  return all;
}

std::string meaning_of(const std::string& name) {
  for (const Derived& d : derived)
    if (name == d.name) return d.meaning;
  return "";
}

std::string reason_of(const std::string& name) {
  for (const auto& [begin, reason] : reasons)
    if (name.rfind(begin, 0) == 0) return reason;
  return "others of its kind change the same statistics";
}

Twin narrowed(const Twin& prior, const std::vector<Estimate>& estimates, double standard_errors) {
  Twin twin = prior;
  for (Range& range : twin.ranges) {
    if (range.key == "radar_cloth") range = {range.key, 1, 1, false};
    const auto found = std::find_if(estimates.begin(), estimates.end(), [&](const Estimate& e) {
      return e.name == range.key && e.told;
    });
    if (found == estimates.end()) continue;
    const double reach = standard_errors * found->standard_error;
    const double factor = std::exp(reach);
    Range narrow = range;
    narrow.low = range.logarithmic ? found->value / factor : found->value - reach;
    narrow.high = range.logarithmic ? found->value * factor : found->value + reach;
    // Shares, counts and what may not cross another key end where they must.
    const bool paired = range.key.rfind("height_m", 0) == 0 || range.key.rfind("albedo_m", 0) == 0;
    if (paired || !may_be(range.key, narrow.low)) narrow.low = std::max(narrow.low, range.low);
    if (paired || !may_be(range.key, narrow.high)) narrow.high = std::min(narrow.high, range.high);
    if (narrow.low < narrow.high) range = narrow;
  }
  return twin;
}

}  // namespace echofuse::sim
