// SPDX-License-Identifier: MIT
#include "acquire/calibrate/calibrate_output.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "drivers/util/printable.hpp"

namespace echofuse::acquire {

nlohmann::ordered_json json_of(const CalibrationResult& r) {
  nlohmann::ordered_json out{{"sensor", name_of(r.sensor)}};
  if (!r.peak.refusal.empty()) {
    out["refusal"] = r.peak.refusal;
    return out;
  }
  out["range_m"] = r.peak.range_m;
  out["true_range_m"] = r.true_range_m;
  out["offset_m"] = r.offset_m();
  out["standard_error_m"] = r.standard_error_m();
  out["measurement_error_m"] = r.peak.standard_error_m;
  out["reflector_error_m"] = r.reflector_error_m;
  out["spread_m"] = r.spread_m;
  out["snr_db"] = r.peak.snr_db;
  return out;
}

void print_text(const CalibrationResult& r) {
  const Peak& p = r.peak;
  if (!p.refusal.empty())
    std::printf("%-6s rejected: %s\n", name_of(r.sensor), printable(p.refusal).c_str());
  else
    std::printf(
        "%-6s %.4f m, offset %+.2f mm +- %.2f mm (standard errors: measurement %.2f mm, reflector "
        "position %.2f mm); spread of the repeats %.2f mm, SNR %.0f dB\n",
        name_of(r.sensor), p.range_m, 1e3 * r.offset_m(), 1e3 * r.standard_error_m(),
        1e3 * p.standard_error_m, 1e3 * r.reflector_error_m, 1e3 * r.spread_m, p.snr_db);
}

nlohmann::ordered_json json_of(const AntennaFit& fit) {
  if (!fit.refusal.empty()) return {{"refusal", fit.refusal}};
  const AntennaGains& g = fit.gains;
  return {{"snr_db", fit.snr_db},
          {"gain", g.gain},
          {"phase_rad", g.phase_rad},
          {"standard_error", g.standard_error}};
}

nlohmann::ordered_json json_of(const WindowFit& fit) {
  return {{"flank_difference", fit.lopsided.value},
          {"standard_error", fit.lopsided.standard_error}};
}

void print_text(const WindowFit& fit) {
  constexpr double min_difference = 0.02, min_errors = 4;
  const auto& [difference, error] = fit.lopsided;
  if (std::abs(difference) < std::max(min_difference, min_errors * error)) return;
  std::printf(
      "radar  asymmetric response: the %s flank is higher by up to %.1f +- %.1f %% of the peak; "
      "both flanks are stored. If this value changes when the reflector is moved, there is a "
      "second echo close to it\n",
      difference > 0 ? "far" : "near", 100 * std::abs(difference), 100 * error);
}

void print_text(const record::Response& r, const Unstated& unstated) {
  if (r.irf_fwhm_ps.value > 0)
    std::printf("spd    impulse response %.1f +- %.1f ps FWHM", r.irf_fwhm_ps.value,
                r.irf_fwhm_ps.standard_error);
  if (r.irf_fwhm_ps.value > 0 && r.irf_tail_share.value > 0)
    std::printf(", %.0f %% of the photons have a tail of %.0f +- %.0f ps",
                100 * r.irf_tail_share.value, r.irf_tail_ps.value, r.irf_tail_ps.standard_error);
  if (r.irf_fwhm_ps.value > 0) std::printf("\n");
  if (r.radar.known())
    std::printf(
        "radar  response %.2f range cells FWHM (cells of %.3f m), standard error of each tap "
        "%.3f\n",
        r.radar.width_m() / r.radar.cell_m, r.radar.cell_m, r.taps_standard_error);
  if (const auto& e = r.radar_noise_exponent; e.value < 0)
    std::printf("radar  noise of an average over n frames is proportional to n^%.2f +- %.2f\n",
                e.value, e.standard_error);
  for (const auto& [key, why] : unstated)
    std::printf("%s not measured: %s\n", key.c_str(), why.c_str());
}

}  // namespace echofuse::acquire
