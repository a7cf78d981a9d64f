// SPDX-License-Identifier: MIT
// Constants of a view, with unit and reason. They are stored in a model file (Alignment::archive);
// a file with other values is refused.
#pragma once

namespace echofuse::recon::method {

// Low quantile of the values in a bin, from which the background of the bin is computed.
inline constexpr double background_quantile = 0.05;
// Returns the background of a bin, from this low quantile and the median of its values.
constexpr float background_level(float low, float median) {
  return 2 * low > median ? 2 * low - median : 0;
}
// A bin is assumed to contain only background if its counts vary by less than this number of
// Poisson standard deviations.
inline constexpr double steadiness = 4;
// Number of passes; a further pass would change the range by less than 1 mm.
inline constexpr int centroid_passes = 3;
inline constexpr double body_m = 0.8;  // half the depth of a body with outstretched arms, m
// Minimum number of counts from a body, in units of the standard deviation of all counts.
inline constexpr double significance = 5;
// Extent of a view's histogram on each side of the body's range, m; large enough to include an
// outstretched arm.
inline constexpr double histogram_m = 0.7;
inline constexpr double histogram_step_m = 0.04;  // about the range width of a 200 ps response
inline constexpr double zone_step_m = 0.2;        // wide, because each zone detects few photons
// Window of the radar profile, m, relative to the range r that the SPD measures. The radar measures
// a range that is longer than r by b x / r (baseline b, lateral position x of the body). The window
// therefore extends farther behind the body than in front of it.
inline constexpr double profile_from_m = -0.8, profile_to_m = 1.1;
// Minimum step of the profile in a view; points of a finer recorded profile are skipped.
inline constexpr double min_profile_step_m = 0.02;
// If the profile step is larger than this value, the profile is also interpolated halfway between
// its points.
inline constexpr double coarse_step_m = 0.08;
// Number of profile steps per range resolution c/2B, for a Blackman window.
inline constexpr double steps_a_resolution = 2;
// Smallest and largest shift of the radar profile to longer ranges. A body at x = 2 m and range 3 m
// shifts the profile by 0.3 m if the baseline is 0.5 m. The largest shift also allows for a range
// bias.
inline constexpr double shift_from_m = -0.3, shift_to_m = 0.6;
// The window of the antenna features is divided into overlapping parts, which describe the extent
// of the body in range. `part_from_m` and `part_to_m` are the centres of the first and the last
// part.
inline constexpr double part_from_m = -0.5;
inline constexpr double part_to_m = 0.65;
// Minimum length of a part of the antenna window, m; a shorter part would contain mostly noise.
inline constexpr double min_part_m = 0.15;
inline constexpr int lags_of_parts = 4;  // largest lag of a part; longer lags add no information
// Number of directions in the grid search. Their spacing is at most a third of the beam width of
// eight antennas.
inline constexpr int directions = 96;
// Number of Newton steps from the best grid direction to the beam's maximum.
inline constexpr int refinements = 3;

}  // namespace echofuse::recon::method
