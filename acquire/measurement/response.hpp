// SPDX-License-Identifier: MIT
// A run states in its table meta how its instruments respond to a point, as `calibrate` has
// measured it or as somebody has written it by hand (`run --meta`):
//   irf_fwhm_ps, irf_tail_ps, irf_tail_share   the SPD's impulse response: a Gaussian, and the
//                        time constant of the exponential tail that a share of the photons has
//   radar_cell_m         c / 2B of the radar
//   radar_taps           the power of its range response at 0, 1/4, 2/4 ... of that, over the power
//                        at 0; of a lopsided response the even part (symmetry_of)
//   radar_noise_exponent the power of the number of frames with which the noise of their mean goes
// A value may have its standard error behind it, "203 +- 2"; the one behind the taps is of each.
#pragma once
#include <array>
#include <functional>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::record {

inline constexpr const char* response_keys[] = {"irf_fwhm_ps",    "irf_tail_ps",
                                                "irf_tail_share", "radar_cell_m",
                                                "radar_taps",     "radar_noise_exponent"};

struct Measured {
  double value = 0, standard_error = 0;  // the error is 0 if it is not known

  bool operator==(const Measured&) const = default;
};
std::string to_text(const Measured& measured);

// Cubic through four values at -1, 0, 1 and 2, between the middle two (Catmull and Rom, 1974).
double catmull_rom(const std::array<double, 4>& values, double t);

struct RadarResponse {
  static constexpr std::size_t taps_a_cell = 4, most_taps = 64;
  double cell_m = 0;
  std::vector<double> taps;  // from 1 on; empty if it is not known

  bool known() const { return cell_m > 0 && !taps.empty(); }
  // Amplitude at a distance in cells, over the peak's: the root of the power, interpolated by a
  // cubic; 0 beyond the taps.
  double amplitude(double cells) const;
  double power(double distance_m) const;
  double width_m() const;  // the full width at half of the peak
  bool operator==(const RadarResponse&) const = default;
};

// A response need not be symmetric. Its range zero is then where a symmetric lobe fits best,
// because a lobe's peak moves the ranges more. Least squares of the powers: the zero z maximises
// the integral of power(z + u) power(z - u), and the even part about z is the lobe.
struct Symmetry {
  double zero = 0, peak = 0;  // cells
  double lopsided = 0;        // greatest power(z + u) - power(z - u), over that at z; signed
};
// Searches zero and peak from `first` to `last`.
Symmetry symmetry_of(const std::function<double(double)>& power, double first, double last);

struct Response {
  Measured irf_fwhm_ps, irf_tail_ps, irf_tail_share;  // not known if the width is 0
  RadarResponse radar;
  double taps_standard_error = 0;
  Measured radar_noise_exponent;  // -1/2 of independent frames; 0 if it is not known

  std::vector<std::pair<std::string, std::string>> meta() const;  // entries of the known parts
  bool operator==(const Response&) const = default;
};

// Response from a run's metadata. Parts not stated, or impossible, are not known.
Response response_of(const std::vector<std::pair<std::string, std::string>>& meta);

// Distance between detector and radar that a run states as radar_baseline_m; 0 if it states none.
double radar_baseline_m(const std::vector<std::pair<std::string, std::string>>& meta);

}  // namespace echofuse::record
