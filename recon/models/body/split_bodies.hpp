// SPDX-License-Identifier: MIT
// A record of two bodies taken apart, where the detector shows them one behind the other: the
// histogram is cut at the valley between its two clusters, and the radar's profile is fitted by
//   a1 h1 (*) psf (R - s1) + a2 h2 (*) psf (R - s2)
// with the two parts h of the histogram, the radar's point spread (body/shift_correlation.hpp),
// amplitudes a >= 0 and shifts s by least squares. Each body gets its part of the histogram, and
// the profile without the other's fitted part.
#pragma once
#include <array>
#include <optional>
#include <span>
#include <vector>

#include "recon/models/body/alignment.hpp"

namespace echofuse::recon {

struct SplitBodies {
  struct Part {
    std::vector<float> raw_inputs;  // as of a record of one body
    double range_m;                 // centroid of its part of the histogram
    double shift_m;                 // how far behind that the radar sees it
  };
  std::array<Part, 2> parts;  // the nearer first
};

// None if the histogram does not show two clusters farther apart than the radar resolves (c/2B), or
// the profile not both of them. Of raw inputs without lags.
std::optional<SplitBodies> split_bodies(const Alignment& alignment,
                                        std::span<const float> raw_inputs);

}  // namespace echofuse::recon
