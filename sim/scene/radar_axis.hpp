// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <vector>

namespace echofuse::sim {

// Point-spread function of the radar over range, as an amplitude with peak 1: transform of the
// window 1 + first cos(2 pi t) + second cos(4 pi t) over the sweep, -1/2 < t < 1/2 (Harris, Proc.
// IEEE 66, 1978). A measured one is the square root of the power, without sign: `taps` of the
// amplitude, a quarter of a cell apart, with range zero at index `zero`, interpolated by a
// Catmull-Rom cubic.
struct Psf {
  double first = 0, second = 0;
  std::vector<double> taps = {};
  double zero = 0;

  static Psf sinc() { return {}; }
  static Psf hann() { return {1, 0}; }
  static Psf hamming() { return {0.46 / 0.54, 0}; }
  static Psf blackman() { return {0.5 / 0.42, 0.08 / 0.42}; }
  // Window between none (t = 0) and Blackman's (t = 1).
  static Psf tapered(double t) { return {t * 0.5 / 0.42, t * t * 0.08 / 0.42}; }
  double at(double cells) const;  // amplitude at a distance in resolution cells

  // With the window the response is
  //   sinc(u) + first [sinc(u-1) + sinc(u+1)]/2 + second [sinc(u-2) + sinc(u+2)]/2
  //     = sinc(u) [4 + (4 first - second - 5) u^2 + (1 - first + second) u^4]
  //       / [(1 - u^2) (4 - u^2)].
  // Windowed is the factor of sinc(u), as a function of u^2.
  struct Windowed {
    double square, fourth;
    double operator()(double u2) const {
      return (4 + u2 * (square + u2 * fourth)) / ((1 - u2) * (4 - u2));
    }
  };
  Windowed windowed() const { return {4 * first - second - 5, 1 - first + second}; }
  // Distance to the poles u = 0, 1 and 2 below which the limit is used.
  static constexpr double nearest = 1e-7;
  // Returns the amplitude for a window, given sin(pi u).
  double at_sine(double u, double sine) const;
};

// Points are at start + i*step; the response to a scatterer at R is psf((R_i - R) / resolution).
struct RadarAxis {
  double start_m = 0;
  double step_m = 0.25;
  std::uint32_t count = 29;
  double resolution_m = 0.5;  // c / 2B: first null of the sinc
  Psf psf;
};

}  // namespace echofuse::sim
