// SPDX-License-Identifier: MIT
// Measures the range of one reflector in the data of the SPD and of the radar. Pure functions.
#pragma once
#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "acquire/calibrate/echo_model.hpp"

namespace echofuse::acquire {

// Search window: its centre is the true range of the reflector; `window_m` is its full width.
struct Search {
  double distance_m = 1, window_m = 0.2;
};

struct Peak {
  double range_m = 0;
  double standard_error_m = 0;
  // SPD: ratio of the amplitude to its standard error. Radar: ratio of the peak power to the median
  // power.
  double snr_db = 0;
  bool outside = false;  // true if the strongest peak is outside the window
  std::string refusal;   // reason why the peak was rejected; empty if it was accepted
};

// SPD: fits a Gaussian on a constant background to the Poisson counts in the window, by maximum
// likelihood (Fisher scoring). Bin i starts at the two-way time start_ps + i*step_ps; the Gaussian
// is integrated over each bin. The standard error is the Cramer-Rao bound. If the IRF has a tail,
// the fitted centre is close to the mean of the IRF, both in a calibration and in a run.
Peak fit_photons(std::span<const std::uint32_t> counts, double start_ps, double step_ps,
                 const Search& search);

struct EchoAxis {
  double step_m = 0, resolution_m = 0;  // bin spacing; range resolution c / 2B (0 if unknown)
  double start_m = 0;                   // range of bin 0

  double range_m(double bin) const { return start_m + bin * step_m; }
};

// Range profiles in linear power, one per frame.
using Profiles = std::vector<std::vector<float>>;
// Returns log2 of the powers. Powers below -80 dB relative to the maximum, also 0, are first raised
// to -80 dB.
std::vector<double> log2_powers(std::span<const float> power);
// Mean and standard deviation of each bin's log2 power over all frames.
struct Profile {
  std::vector<double> mean, deviation;
  double floor = 0;  // median of `mean` over all bins
};

Profile profile_of(const Profiles& frames);

// Radar: fits the range of an echo to range profiles. Needs at least max(`min_frames`, 2) frames.
// Fits the transform of the window by least squares, weighted with the power, to the mean log power
// of five bins: the strongest one and two on each side. The amplitude is also fitted. The default
// is the Blackman window of the firmware (SDK 3.x, mmwDemo_genWindow; Harris, Proc. IEEE 66, 1978).
// In the model, the mean of ln power for a signal P in noise N is ln P + E1(P / N); N is derived
// from the median of the profile. If the resolution is unknown, the range is the vertex of a
// parabola through the logarithms of three bins. The standard error is derived from the scatter of
// the frames. The quantisation error of the firmware's codes is added unless noise averages it out.
inline constexpr std::size_t min_echo_frames = 8;
Peak fit_echo(const Profiles& frames, const EchoAxis& axis, const Search& search,
              const Window& window = {}, std::size_t min_frames = min_echo_frames);

inline double spread_of(const std::vector<double>& values) {
  if (values.size() < 2) return 0;
  double mean = 0, squares = 0;
  for (const double v : values) mean += v / static_cast<double>(values.size());
  for (const double v : values) squares += (v - mean) * (v - mean);
  return std::sqrt(squares / static_cast<double>(values.size() - 1));
}

// Returns the standard error of the mean of the repeats. Normally this is `standard_error`. If the
// spread of the repeats exceeds the value expected from noise by more than four standard errors,
// the reflector or a sensor has moved. The standard error is then derived from the spread.
inline double honest_error(double standard_error, const std::vector<double>& repeats) {
  const auto n = static_cast<double>(repeats.size());
  if (n < 3) return standard_error;
  const double expected = standard_error * std::sqrt(n), seen = spread_of(repeats);
  const bool moved = seen > expected * (1 + 4 / std::sqrt(2 * (n - 1)));
  return moved ? seen / std::sqrt(n) : standard_error;
}

}  // namespace echofuse::acquire
