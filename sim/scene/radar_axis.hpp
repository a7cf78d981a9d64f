// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <vector>

namespace echofuse::sim {

// Range response (point-spread function) of the radar, as an amplitude with peak 1.
// If `taps` is empty, the response is the Fourier transform of the window
//   1 + first cos(2 pi t) + second cos(4 pi t), -1/2 < t < 1/2
// over the sweep (Harris, Proc. IEEE 66, 1978). Otherwise it is a measured response: `taps` are the
// square roots of the measured power, a quarter of a resolution cell apart. Range zero is at index
// `zero`, and a Catmull-Rom cubic interpolates the taps.
struct Psf {
  double first = 0, second = 0;
  std::vector<double> taps = {};
  double zero = 0;

  static Psf sinc() { return {}; }
  static Psf hann() { return {1, 0}; }
  static Psf hamming() { return {0.46 / 0.54, 0}; }
  static Psf blackman() { return {0.5 / 0.42, 0.08 / 0.42}; }
  // Interpolates between no window (t = 0) and the Blackman window (t = 1).
  static Psf tapered(double t) { return {t * 0.5 / 0.42, t * t * 0.08 / 0.42}; }
  // returns the amplitude at this distance from the scatterer, in resolution cells
  double at(double cells) const;

  // The response for this window, at a distance u in resolution cells, is
  //   sinc(u) + first [sinc(u-1) + sinc(u+1)]/2 + second [sinc(u-2) + sinc(u+2)]/2
  //     = sinc(u) [4 + (4 first - second - 5) u^2 + (1 - first + second) u^4]
  //       / [(1 - u^2) (4 - u^2)].
  // Windowed computes the factor of sinc(u) from u^2.
  struct Windowed {
    double square, fourth;
    double operator()(double u2) const {
      return (4 + u2 * (square + u2 * fourth)) / ((1 - u2) * (4 - u2));
    }
  };
  Windowed windowed() const { return {4 * first - second - 5, 1 - first + second}; }
  // The formula is 0 / 0 at u = 0, +-1 and +-2. Its limit is used within this distance of these
  // values of u.
  static constexpr double nearest = 1e-7;
  // Returns the amplitude for a window. `sine` is sin(pi u).
  double at_sine(double u, double sine) const;
};

// Range axis with points at R_i = start_m + i step_m. The amplitude of the response to a scatterer
// at range R is psf((R_i - R) / resolution_m).
struct RadarAxis {
  double start_m = 0;
  double step_m = 0.25;
  std::uint32_t count = 29;
  double resolution_m = 0.5;  // c / 2B: distance from the peak of the sinc to its first null
  Psf psf;
};

}  // namespace echofuse::sim
