// SPDX-License-Identifier: MIT
#include "acquire/measurement/response.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/util/format.hpp"

namespace echofuse::record {
namespace {

struct ValidRange {
  double minimum, maximum;
};
constexpr ValidRange widths_ps{min_width_ps, max_width_ps}, tails_ps{0, 100'000}, shares{0, 1},
    cells_m{1e-3, 10}, exponents{-2, 0}, powers{0, 1.05}, baselines_m{0, 10},
    tolerances_m{0, max_mount_tolerance_m};
constexpr const char *baseline_key = "radar_baseline_m", *tolerance_key = "radar_mount_tolerance_m";

// Parses numbers with an optional "+- ERROR" at the end. Returns an empty list if the string does
// not have this form or a number is outside its range.
std::vector<double> numbers_of(const std::string& text, const ValidRange& range, double& error) {
  const auto plus = text.find("+-");
  const std::vector<double> out = numbers_in(text.substr(0, plus));
  error = 0;
  if (plus != std::string::npos) {
    const auto errors = numbers_in(text.substr(plus + 2));
    if (errors.size() != 1 || !(errors[0] >= 0)) return {};
    error = errors[0];
  }
  const auto possible = [&](double v) { return v >= range.minimum && v <= range.maximum; };
  return std::all_of(out.begin(), out.end(), possible) ? out : std::vector<double>{};
}

void take(const std::string& text, const ValidRange& range, Measured& out) {
  double error = 0;
  if (const auto found = numbers_of(text, range, error); found.size() == 1) out = {found[0], error};
}

std::string number_text(double v) { return format("%.6g", v); }

}  // namespace

std::string to_text(const Measured& m) {
  return number_text(m.value) +
         (m.standard_error > 0 ? " +- " + number_text(m.standard_error) : std::string());
}

double catmull_rom(const std::array<double, 4>& values, double t) {
  const auto [a, b, c, d] = values;
  return b + t / 2 * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

std::size_t RadarResponse::peak() const {
  if (taps.empty() || std::abs(taps[0] - 1) < 1e-3) return 0;
  return static_cast<std::size_t>(std::max_element(taps.begin(), taps.end()) - taps.begin());
}

bool RadarResponse::valid() const {
  return taps.size() >= 3 && taps.size() <= max_taps && std::abs(taps[peak()] - 1) < 1e-3;
}

double RadarResponse::amplitude(double cells) const {
  const auto top = static_cast<double>(peak()), count = static_cast<double>(taps.size());
  const double side = top > 0 && cells < 0 ? -1 : 1;
  const double place = std::abs(cells) * taps_a_cell, whole = std::floor(place);
  if (!(place < (side < 0 ? top + 1 : count - top))) return 0;
  const auto value = [&](double distance) {
    const double tap = top > 0 ? top + side * distance : std::abs(distance);
    return tap >= 0 && tap < count ? std::sqrt(taps[static_cast<std::size_t>(tap)]) : 0;
  };
  return catmull_rom({value(whole - 1), value(whole), value(whole + 1), value(whole + 2)},
                     place - whole);
}

double RadarResponse::power(double distance_m) const {
  const double a = amplitude(distance_m / cell_m);
  return a * a;
}

double RadarResponse::width_m() const {
  const double step_m = cell_m / taps_a_cell / 64;
  const auto half_m = [&](double side) {
    double out = 0;
    while (power(side * out) > 0.5) out += step_m;
    return out;
  };
  return half_m(-1) + half_m(1);
}

std::vector<std::pair<std::string, std::string>> Response::meta() const {
  std::vector<std::pair<std::string, std::string>> out;
  if (irf_fwhm_ps.value > 0) {
    out.emplace_back("irf_fwhm_ps", to_text(irf_fwhm_ps));
    out.emplace_back("irf_tail_ps", to_text(irf_tail_ps));
    out.emplace_back("irf_tail_share", to_text(irf_tail_share));
  }
  if (radar.known()) {
    std::string taps;
    for (const double tap : radar.taps)
      taps.append(taps.empty() ? 0 : 1, ' ').append(number_text(tap));
    if (taps_standard_error > 0) taps.append(" +- ").append(number_text(taps_standard_error));
    out.emplace_back("radar_cell_m", number_text(radar.cell_m));
    out.emplace_back("radar_taps", taps);
  }
  if (radar_noise_exponent.value < 0)
    out.emplace_back("radar_noise_exponent", to_text(radar_noise_exponent));
  return out;
}

Response response_of(const std::vector<std::pair<std::string, std::string>>& meta) {
  Response out;
  Measured cell;
  for (const auto& [key, text] : meta) {
    if (key == "irf_fwhm_ps") take(text, widths_ps, out.irf_fwhm_ps);
    if (key == "irf_tail_ps") take(text, tails_ps, out.irf_tail_ps);
    if (key == "irf_tail_share") take(text, shares, out.irf_tail_share);
    if (key == "radar_noise_exponent") take(text, exponents, out.radar_noise_exponent);
    if (key == "radar_cell_m") take(text, cells_m, cell);
    if (key != "radar_taps") continue;
    out.radar.taps = numbers_of(text, powers, out.taps_standard_error);
    if (!out.radar.valid()) out.radar.taps.clear();
  }
  out.radar.cell_m = cell.value;
  if (!out.radar.known()) out.radar = {}, out.taps_standard_error = 0;
  return out;
}

std::string fault_of_width(const std::vector<std::pair<std::string, std::string>>& meta,
                           double bin_width_ps) {
  constexpr double shortest_in_bins = 0.02;
  const double fwhm_ps = response_of(meta).irf_fwhm_ps.value;
  if (fwhm_ps <= 0 || fwhm_ps >= shortest_in_bins * bin_width_ps) return {};
  return format("irf_fwhm_ps is %g ps, but the bins have %g ps: is the width in ns?", fwhm_ps,
                bin_width_ps);
}

bool is_response(const std::vector<std::pair<std::string, std::string>>& meta) {
  const auto known = response_of(meta).meta();
  return std::ranges::all_of(meta, [&](const auto& entry) {
    const auto is_key = [&](const auto& k) { return k.first == entry.first; };
    return std::ranges::find(response_keys, entry.first) == std::end(response_keys) ||
           std::ranges::any_of(known, is_key);
  });
}

std::vector<std::pair<std::string, std::string>> RadarMounting::meta() const {
  return {{baseline_key, to_text({baseline_m, 0})}, {tolerance_key, to_text({tolerance_m, 0})}};
}

RadarMounting radar_mounting_of(const std::vector<std::pair<std::string, std::string>>& meta) {
  const RadarMounting usual;
  Measured baseline{usual.baseline_m, 0}, tolerance{usual.tolerance_m, 0};
  for (const auto& [key, text] : meta) {
    if (key == baseline_key) take(text, baselines_m, baseline);
    if (key == tolerance_key) take(text, tolerances_m, tolerance);
  }
  return {baseline.value, tolerance.value};
}

}  // namespace echofuse::record
