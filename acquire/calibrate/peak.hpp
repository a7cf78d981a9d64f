// SPDX-License-Identifier: MIT
// Range of one reflector in the data of the two ranging sensors. Pure.
#pragma once
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquire/calibrate/echo_model.hpp"

namespace echofuse::acquire {

// Window in which the reflector is searched: its true range from the sensor and the full width.
struct Search {
  double distance_m = 1, window_m = 0.2;
};

struct Peak {
  double range_m = 0;
  double standard_error_m = 0;
  double snr_db = 0;     // SPD: amplitude over its standard error; radar: power over the median
  bool outside = false;  // the strongest peak, outside the window
  std::string refusal;   // reason to refuse the peak, or empty
};

// SPD: counts per bin of two-way time, bin i from start_ps + i*step_ps. Maximum likelihood, by
// Fisher scoring, of a Gaussian of free width, integrated over each bin, on an even background;
// counts are Poisson. Only what stands in the window is looked at. The standard error is the
// Cramer-Rao bound at the maximum. The peak of an IRF with a tail comes out near its mean, wherever
// that of the runs does.
Peak fit_photons(std::span<const std::uint32_t> counts, double start_ps, double step_ps,
                 const Search& search);

struct EchoAxis {
  double step_m = 0, resolution_m = 0;  // between bins; c / 2B, 0: not known
  double log2_power_step = 0;           // per code (drivers/core/log2_codes.hpp)
  double start_m = 0;                   // range of bin 0

  double range_m(double bin) const { return start_m + bin * step_m; }
};

// Codes of linear power, for radars that send power: 256 * (log2(power) + 128), at most 60 dB below
// the frame's maximum.
std::vector<std::uint16_t> power_codes(std::span<const float> power);
inline constexpr double power_code_step = 1.0 / 256;
// Mean and standard deviation of each bin over the frames.
struct Profile {
  std::vector<double> mean, deviation;  // log2 of the power
  double floor = 0;                     // median of the means
};

Profile profile_of(const std::vector<std::vector<std::uint16_t>>& frames, double log2_power_step);

// Radar: range profiles in log2_q8 codes, one a frame, `least` or more (at
// least 2). Least squares fit of the
// window's transform to the frames' means of the strongest bin and its two neighbours on either
// side. The amplitude is free, and the bins are weighted with the power. Window: the firmware's
// Blackman if no other is given (SDK 3.x, mmwDemo_genWindow; Harris, Proc. IEEE 66, 1978). The mean
// of a logarithm is that of a signal P in noise N: ln P + E1(P / N), N from the profile's median.
// If the resolution is not known, a parabola through the logarithms of three bins places the echo.
// The standard error is that of the frames' scatter, and of the codes' steps where the noise does
// not even them out.
inline constexpr std::size_t least_echo_frames = 8;
Peak fit_echo(const std::vector<std::vector<std::uint16_t>>& frames, const EchoAxis& axis,
              const Search& search, const Window& window = {},
              std::size_t least = least_echo_frames);

// Standard deviation.
inline double spread_of(const std::vector<double>& values) {
  if (values.size() < 2) return 0;
  double mean = 0, squares = 0;
  for (const double v : values) mean += v / static_cast<double>(values.size());
  for (const double v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

// Noise alone gives the repeats a spread of `expected`; beyond four of its own standard errors
// something moved, and the spread is what the mean is known to.
inline double honest_error(double standard_error, const std::vector<double>& repeats) {
  const auto n = static_cast<double>(repeats.size());
  if (n < 3) return standard_error;
  const double expected = standard_error * std::sqrt(n), seen = spread_of(repeats);
  const bool moved = seen > expected * (1 + 4 / std::sqrt(2 * (n - 1)));
  return moved ? seen / std::sqrt(n) : standard_error;
}

}  // namespace echofuse::acquire
