// SPDX-License-Identifier: MIT
#include "recon/method/config.hpp"

namespace echofuse::recon {
namespace {

// Calls visit(key, value, least, most, text) for each number.
template <class Visit>
void for_each_key(MethodConfig& c, Visit&& visit) {
  visit("background_quantile", c.background_quantile, 0.0, 0.5,
        "share of the records that are below what is always there");
  visit("steadiness", c.steadiness, 0.0, 100.0,
        "standard deviations of a Poisson count: a bin that scatters less is all background");
  visit("centroid_passes", c.centroid_passes, 1, 20, "passes of the body's range");
  visit("body_m", c.body_m, 0.1, 5.0, "m, half the depth of a body");
  visit("significance", c.significance, 0.0, 100.0,
        "standard deviations of all counts: fewer above the background show nobody");
  visit("histogram_m", c.histogram_m, 0.1, 5.0, "m, of the histogram on either side of the body");
  visit("histogram_step_m", c.histogram_step_m, 0.005, 1.0, "m, of its bins");
  visit("profile_from_m", c.profile_from_m, -5.0, 0.0, "m, of the profile in front of the body");
  visit("profile_to_m", c.profile_to_m, 0.1, 5.0, "m, of the profile behind it");
  visit("least_profile_step_m", c.least_profile_step_m, 0.005, 1.0, "m, between its points");
  visit("coarse_step_m", c.coarse_step_m, 0.005, 1.0,
        "m, from which step on a profile is read halfway between its points, too");
  visit("steps_a_resolution", c.steps_a_resolution, 0.5, 10.0,
        "steps of the profile in the radar's resolution c/2B");
  visit("shift_from_m", c.shift_from_m, -2.0, 0.0, "m, shortest shift between both sensors");
  visit("shift_to_m", c.shift_to_m, 0.1, 2.0, "m, longest shift between both sensors");
  visit("part_from_m", c.part_from_m, -2.0, 0.0, "m, first part of the antennas' view");
  visit("part_to_m", c.part_to_m, 0.1, 2.0, "m, last part of the antennas' view");
  visit("least_part_m", c.least_part_m, 0.01, 1.0, "m, between its parts");
  visit("lags_of_parts", c.lags_of_parts, 1, 16, "lags of each part");
  visit("directions", c.directions, 8, 1024, "directions in which the beam is looked for");
  visit("refinements", c.refinements, 0, 20, "Newton's steps to the beam's maximum");
  visit("nearest_m", c.nearest_m, 0.01, 10.0, "m, nearest distance of a body");
  visit("least_deviation", c.least_deviation, 1e-6, 1.0,
        "least standard deviation of an input, as a share of the median one");
  visit("threshold_from", c.threshold_from, 0.05, 0.95, "least threshold of the mask");
  visit("threshold_to", c.threshold_to, 0.05, 0.95, "greatest threshold of the mask");
  visit("many_records", c.many_records, 100, 1'000'000'000,
        "records from which on the networks are wide and learn in larger steps");
  visit("units", c.units, 1, 65'536, "of each of the two hidden layers of place and shape");
  visit("units_of_many", c.units_of_many, 1, 65'536, "the same with many records");
  visit("place_networks", c.place_networks, 1, 64, "whose mean is the place");
  visit("shape_networks", c.shape_networks, 1, 64, "whose mean is the shape; of many records 1");
  visit("depth_weight", c.depth_weight, 1e-6, 1e6, "of the depth's error, that of the side is 1");
  visit("component_bodies", c.component_bodies, 10, 1'000'000,
        "records that the components of masks and depths are made of");
  visit("turned_records", c.turned_records, 100, 1'000'000'000,
        "records from which on half of the bodies are not turned");
}

}  // namespace

void bind(Settings& settings, MethodConfig& config) {
  for_each_key(config, [&](const char* key, auto& value, auto least, auto most, const char* text) {
    settings.add(key, value, least, most, text);
  });
}

void archive(Archive archive, MethodConfig& config) {
  for_each_key(config, [&](const char* key, auto& value, auto least, auto most, const char*) {
    if constexpr (std::is_same_v<decltype(value), double&>)
      archive.number(key, value, least, most);
    else
      archive.count(key, value, least, most);
  });
}

}  // namespace echofuse::recon
