// SPDX-License-Identifier: MIT
// Measures how much detail a scene needs: each approximation of the simulated world is compared
// with a finer one, and its cost is given.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// Result of one approximation, over the same scenes (a quarter people, the rest letters).
struct Fidelity {
  std::string axis;   // rays, part, bin_ps, radar_rays
  std::string value;  // "256", "head"
  // Mean over bins of (approximate - fine)^2 / variance of the noise. The noise is shot noise of
  // the SPD's counts in bins of at least one expected count, or the stated white noise of the
  // radar.
  double error = 0;
  double standard_error = 0;  // over scenes
  double us = 0;  // processor time of one scene on this machine; 0 if it does not matter
};

struct FidelityOptions {
  Conditions conditions;
  std::int64_t scenes = 40;
  std::uint64_t seed = 1;
  bool quiet = false;
};

// Throws Error(interrupted). The axes are:
//   rays        of the SPD, against 2048
//   part        the body without it, against the whole body, at 1024 rays
//   bin_ps      the histogram with this bin, spread evenly over bins a quarter as wide
//   radar_rays  against 1536 rays of the radar
std::vector<Fidelity> study_fidelity(const FidelityOptions& options);

// Writes fidelity.csv in `folder`. Throws Error(disk).
void write_fidelity(const std::vector<Fidelity>& rows, const std::string& folder);

}  // namespace echofuse::sim
