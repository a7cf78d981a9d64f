// SPDX-License-Identifier: MIT
// Response of the sensors to a point target. The metadata of a run contain it, if `calibrate`
// measured it or a user entered it (`run --meta`). Keys:
//   irf_fwhm_ps          full width at half maximum of the SPD's impulse response, a Gaussian
//   irf_tail_ps          time constant of the exponential tail of this response
//   irf_tail_share       fraction of the photons in the tail
//   radar_cell_m         range resolution c / 2B of the radar
//   radar_taps           power of the radar's range response in steps of 1/4 cell, relative to its
//                        peak; a list that begins with the peak describes a symmetric response
//   radar_noise_exponent exponent n: the noise of a mean over N frames is proportional to N^n
// A value may include a standard error: "203 +- 2". A standard error after the taps applies to
// every tap.
#pragma once
#include <array>
#include <cmath>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::record {

inline constexpr const char* response_keys[] = {"irf_fwhm_ps",    "irf_tail_ps",
                                                "irf_tail_share", "radar_cell_m",
                                                "radar_taps",     "radar_noise_exponent"};

// limits of irf_fwhm_ps
inline constexpr double min_width_ps = 0.1, max_width_ps = 100'000;

struct Measured {
  double value = 0, standard_error = 0;  // `standard_error` is 0 if unknown

  bool operator==(const Measured&) const = default;
};
std::string to_text(const Measured& measured);

// Interpolates between the values at 0 and 1 with a cubic (Catmull and Rom, 1974); t is between 0
// and 1. `values` contains the values at -1, 0, 1 and 2.
double catmull_rom(const std::array<double, 4>& values, double t);

struct RadarResponse {
  static constexpr std::size_t taps_a_cell = 4, max_taps = 64;
  double cell_m = 0;
  // Powers in steps of 1/4 cell towards larger ranges, relative to the peak; empty if unknown. If
  // the first tap is the peak, the response is symmetric.
  std::vector<double> taps;

  bool known() const { return cell_m > 0 && !taps.empty(); }
  std::size_t peak() const;  // index of the tap at the peak; 0 for a symmetric response
  bool valid() const;        // true if the number of taps is allowed and the peak is 1
  // Returns the amplitude at a signed distance in cells, relative to the peak. The amplitude is the
  // square root of the power, interpolated with a cubic; it is 0 beyond the taps.
  double amplitude(double cells) const;
  double power(double distance_m) const;
  double width_m() const;  // full width at half maximum of the power
  bool operator==(const RadarResponse&) const = default;
};

// Full width at half maximum of a Gaussian with sigma 1.
inline const double fwhm_of_sigma = std::sqrt(8 * std::numbers::ln2);

struct Response {
  Measured irf_fwhm_ps, irf_tail_ps, irf_tail_share;  // unknown if `irf_fwhm_ps` is 0
  RadarResponse radar;
  double taps_standard_error = 0;
  Measured radar_noise_exponent;  // -1/2 if the noise is independent between frames; 0 if unknown

  // Returns the metadata entries of the known parts.
  std::vector<std::pair<std::string, std::string>> meta() const;
  bool operator==(const Response&) const = default;
};

// Reads the response from the metadata of a run. Missing or invalid parts remain unknown.
Response response_of(const std::vector<std::pair<std::string, std::string>>& meta);
// Returns why a detector with the stated response would not record with bins of this width, or an
// empty string. A width that is 50 times shorter than a bin is probably given in ns.
std::string fault_of_width(const std::vector<std::pair<std::string, std::string>>& meta,
                           double bin_width_ps);
// Returns true if response_of() reads all entries of the metadata that have one of response_keys.
bool is_response(const std::vector<std::pair<std::string, std::string>>& meta);

inline constexpr double max_mount_tolerance_m = 0.1;

struct RadarMounting {
  double baseline_m = 0;  // distance between the detector and the radar; 0 if unknown
  // Standard deviation of the error of the difference between radar range and SPD range that
  // results from movements of the mounts since the calibration.
  double tolerance_m = 0.003;

  std::vector<std::pair<std::string, std::string>> meta() const;
};

// Reads the mounting from the metadata of a run. Missing or invalid parts keep their default.
RadarMounting radar_mounting_of(const std::vector<std::pair<std::string, std::string>>& meta);

}  // namespace echofuse::record
