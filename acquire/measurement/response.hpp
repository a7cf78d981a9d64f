// SPDX-License-Identifier: MIT
// Response of the instruments to a point target, stated in a run's table meta, as `calibrate`
// measured it or as a user entered it (`run --meta`):
//   irf_fwhm_ps, irf_tail_ps, irf_tail_share   impulse response of the SPD: a Gaussian, and the
//                        time constant and photon share of its exponential tail
//   radar_cell_m         c / 2B of the radar
//   radar_taps           power of its range response at 0, 1/4, 2/4 ... cells, relative to the
//                        power at 0; of an asymmetric response the even part (symmetry_of)
//   radar_noise_exponent exponent n: the noise of a mean over N frames is ~ N^n
// Values may include a standard error, "203 +- 2"; behind the taps it applies to each tap.
#pragma once
#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::record {

inline constexpr const char* response_keys[] = {"irf_fwhm_ps",    "irf_tail_ps",
                                                "irf_tail_share", "radar_cell_m",
                                                "radar_taps",     "radar_noise_exponent"};

struct Measured {
  double value = 0, standard_error = 0;  // standard_error is 0 if unknown

  bool operator==(const Measured&) const = default;
};
std::string to_text(const Measured& measured);

// Cubic through four values at -1, 0, 1 and 2, between the middle two (Catmull and Rom, 1974).
double catmull_rom(const std::array<double, 4>& values, double t);

struct RadarResponse {
  static constexpr std::size_t taps_a_cell = 4, most_taps = 64;
  double cell_m = 0;
  std::vector<double> taps;  // starting with 1; empty if unknown

  bool known() const { return cell_m > 0 && !taps.empty(); }
  // Returns the amplitude at a distance in cells, relative to the peak: square root of the power,
  // with cubic interpolation; 0 beyond the taps.
  double amplitude(double cells) const;
  double power(double distance_m) const;
  double width_m() const;  // full width at half maximum
  bool operator==(const RadarResponse&) const = default;
};

// Zero of an asymmetric response: where a symmetric lobe fits best, because the peak would displace
// the ranges more. Least squares of the powers: the zero z maximises the integral of power(z + u)
// power(z - u), and the even part about z is the lobe.
struct Symmetry {
  double zero = 0, peak = 0;  // cells
  double lopsided = 0;        // largest power(z + u) - power(z - u), relative to the power at z;
                              // signed
};
// Searches zero and peak from `first` to `last`.
Symmetry symmetry_of(const std::function<double(double)>& power, double first, double last);

// Full width at half maximum of a Gaussian with sigma 1.
inline const double fwhm_of_sigma = std::sqrt(8 * std::numbers::ln2);

struct Response {
  Measured irf_fwhm_ps, irf_tail_ps, irf_tail_share;  // unknown if the width is 0
  RadarResponse radar;
  double taps_standard_error = 0;
  Measured radar_noise_exponent;  // -1/2 for independent frames; 0 if unknown

  std::vector<std::pair<std::string, std::string>> meta() const;  // meta entries of the known parts
  bool operator==(const Response&) const = default;
};

// Returns the response from a run's metadata; missing or impossible parts are unknown.
Response response_of(const std::vector<std::pair<std::string, std::string>>& meta);

// Returns the stated distance between detector and radar (radar_baseline_m), or 0 if it is not
// stated.
double radar_baseline_m(const std::vector<std::pair<std::string, std::string>>& meta);

}  // namespace echofuse::record
