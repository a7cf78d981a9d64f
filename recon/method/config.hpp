// SPDX-License-Identifier: MIT
// The numbers of the method are in one place, each with its unit and the reason for its value.
// `train --set KEY=VALUE` changes one; a model's file keeps them, as its views depend on them.
#pragma once
#include <cstdint>

#include "drivers/program/settings.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct MethodConfig {
  // Background.
  double background_quantile = 0.05;  // share of records; 95 % have nobody in a given place
  double steadiness = 4;              // Poisson deviations; a bin that scatters less is background
  // Range of the body.
  std::int64_t centroid_passes = 3;  // one more moves it by less than a millimetre
  double body_m = 0.8;               // half the depth of a body with outstretched arms
  double significance = 5;           // deviations of all counts: fewer show nobody
  // View of the body, about its range.
  double histogram_m = 0.7;            // on either side: a body, and an arm stretched out
  double histogram_step_m = 0.04;      // about the width of a detector's response of 200 ps
  double profile_from_m = -0.8;        // the radar sees a body at x farther by b x / r,
  double profile_to_m = 1.1;           // so there is more room behind than in front
  double least_profile_step_m = 0.02;  // points of a fine profile that lie closer are left out
  double coarse_step_m = 0.08;         // a coarser profile is read halfway between its points, too
  double steps_a_resolution = 2;       // steps of the profile that make c/2B, Blackman window
  double shift_from_m = -0.3;          // shifts between both sensors: 2 m aside at 3 m and a
  double shift_to_m = 0.6;  // baseline of .5 m make .3 m, and the radar may read too long
  // Features of the radar's antennas.
  double part_from_m = -0.5;       // centres of the overlapping parts of the window
  double part_to_m = 0.65;         // last part, m; the parts show how far the body spreads
  double least_part_m = 0.15;      // a part of one fine bin would be noise
  std::int64_t lags_of_parts = 4;  // longer lags say no more of parts
  std::int64_t directions = 96;    // a third of the beam of eight antennas apart, or less
  std::int64_t refinements = 3;    // Newton's steps from there to the beam's maximum
  // Place and shape of the body.
  double nearest_m = 0.1;         // no body is taken to be nearer
  double least_deviation = 0.05;  // share of the median deviation; least scale of an input
  // A model keeps the threshold of the mask in this range that is best on held-out records. With an
  // uncertain place a mask wider than that of 1/2 overlaps best.
  double threshold_from = 0.25;
  double threshold_to = 0.6;
  // Networks, each with two hidden layers.
  std::int64_t many_records = 10'000;  // from here on: wider layers, fewer and larger steps
  std::int64_t units = 48;             // widths of hidden layers that do best with few records,
  std::int64_t units_of_many = 96;     // and with many
  std::int64_t place_networks = 3;     // the mean of several places better than one
  std::int64_t shape_networks = 2;     // with many records one is as good
  // Relative to the side: the depth is nearly the range, and a network that cares for both learns
  // less of the side.
  double depth_weight = 0.1;
  std::int64_t component_bodies = 3000;  // more hardly turn the components
  std::int64_t turned_records = 40'000;  // from here on half of them stay: turning approximates
};

// Binds the values as keys of settings, with unit, meaning and range.
void bind(Settings& settings, MethodConfig& config);
void archive(Archive archive, MethodConfig& config);

}  // namespace echofuse::recon
