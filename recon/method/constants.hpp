// SPDX-License-Identifier: MIT
// Constants of a view, with unit and reason. They are part of a model file (Alignment::archive); a
// file with other values is refused.
#pragma once

namespace echofuse::recon::method {

// Background.
inline constexpr double background_quantile = 0.05;  // share of records; at a given range 95 % have
                                                     // no body
inline constexpr double steadiness =
    4;  // Poisson standard deviations; a bin that varies less is background
// Range of the body.
inline constexpr int centroid_passes = 3;  // another pass changes the range by less than 1 mm
inline constexpr double body_m = 0.8;      // half the depth of a body with outstretched arms
inline constexpr double significance = 5;  // standard deviations of all counts: fewer mean no body
// View of a body, relative to its range.
inline constexpr double histogram_m = 0.7;        // on each side: a body with an outstretched arm
inline constexpr double histogram_step_m = 0.04;  // about the width of a 200 ps response
inline constexpr double zone_step_m = 0.2;        // coarser, because zones have few photons
// The radar's range of a body at x is larger by b x / r, so the window extends farther to the back.
inline constexpr double profile_from_m = -0.8, profile_to_m = 1.1;
inline constexpr double least_profile_step_m = 0.02;  // points of a finer profile are skipped
inline constexpr double coarse_step_m =
    0.08;  // a coarser profile is also interpolated half way between its points
inline constexpr double steps_a_resolution = 2;  // profile steps per c/2B, Blackman window
// Shifts between both sensors: 0.3 m at x = 2 m, range 3 m and a baseline of 0.5 m, plus a radar
// bias towards longer ranges.
inline constexpr double shift_from_m = -0.3, shift_to_m = 0.6;
// Features of the radar's antennas.
inline constexpr double part_from_m = -0.5;   // centres of the overlapping parts of the window
inline constexpr double part_to_m = 0.65;     // centre of the last part; the parts show the body's
                                              // extent in range
inline constexpr double least_part_m = 0.15;  // shorter parts would contain mostly noise
inline constexpr int lags_of_parts = 4;       // longer lags of parts add no information
inline constexpr int directions = 96;  // spacing: at most a third of the beam of eight antennas
inline constexpr int refinements = 3;  // Newton steps from the grid to the beam's maximum

}  // namespace echofuse::recon::method
