// SPDX-License-Identifier: MIT
// Numbers of a view, each with its unit and the reason for its value. A model file states them
// (Alignment::archive), and a file with other numbers is refused.
#pragma once

namespace echofuse::recon::method {

// Background.
inline constexpr double background_quantile = 0.05;  // share of records; 95 % have nobody there
inline constexpr double steadiness =
    4;  // Poisson deviations; a bin that scatters less is background
// Range of the body.
inline constexpr int centroid_passes = 3;  // one more moves it by less than a millimetre
inline constexpr double body_m = 0.8;      // half the depth of a body with outstretched arms
inline constexpr double significance = 5;  // deviations of all counts: fewer show nobody
// View of the body, about its range.
inline constexpr double histogram_m = 0.7;  // on either side: a body, and an arm stretched out
inline constexpr double histogram_step_m = 0.04;  // about the width of a response of 200 ps
inline constexpr double zone_step_m = 0.2;  // coarser in the zones, which have few photons each
// The radar sees a body at x farther by b x / r, so there is more room behind than in front.
inline constexpr double profile_from_m = -0.8, profile_to_m = 1.1;
inline constexpr double least_profile_step_m =
    0.02;  // closer points of a fine profile are left out
inline constexpr double coarse_step_m =
    0.08;  // a coarser profile is read halfway between its points
inline constexpr double steps_a_resolution =
    2;  // steps of the profile that make c/2B, Blackman window
// Shifts between both sensors: 2 m aside at 3 m and a baseline of .5 m make .3 m, and the radar may
// read too long.
inline constexpr double shift_from_m = -0.3, shift_to_m = 0.6;
// Features of the radar's antennas.
inline constexpr double part_from_m = -0.5;  // centres of the overlapping parts of the window
inline constexpr double part_to_m = 0.65;  // the last part; the parts show how far the body spreads
inline constexpr double least_part_m = 0.15;  // a part of one fine bin would be noise
inline constexpr int lags_of_parts = 4;       // longer lags say no more of parts
inline constexpr int directions = 96;  // a third of the beam of eight antennas apart, or less
inline constexpr int refinements = 3;  // Newton's steps from there to the beam's maximum

}  // namespace echofuse::recon::method
