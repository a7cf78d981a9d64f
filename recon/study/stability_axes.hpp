// SPDX-License-Identifier: MIT
// The conditions under which a study of stability tries the models: one axis a condition, from easy
// to broken. A room behind bodies after training without one is not among them: the truth would
// need another background than the model's; "rooms" has them in training, too.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// The simulator's settings that are numbers, by key; of those that are words, KEY=WORD is 1.
using BaseCondition = std::map<std::string, double>;
// This is how many antennas the radar has there.
double antennas_of(const BaseCondition& base);

// This is what happens to records after they were measured.
enum class Damage : std::uint8_t { none, spd_zero, radar_zero, spd_missing, radar_missing };

// A world, as far as it differs from the simulator's base condition.
struct World {
  std::vector<std::string> set = {};  // KEY=VALUE of `echofuse-sim dataset --set`
  std::string scenes = "records";     // or people, letters, two-people, empty
  std::optional<double> at_x_m = {};  // all stand at x or -x, one half each
  double walks_m = 0;                 // way of people through a record, in a random direction
  double records = 1;                 // training records, as a factor
  double radar_gain = 1;              // of all that the radar says, noise and all
  Damage damage = Damage::none;

  bool base() const {
    return measured_at_base() && records == 1 && radar_gain == 1 && damage == Damage::none;
  }
  bool measured_at_base() const {
    return set.empty() && scenes == "records" && !at_x_m && walks_m == 0;
  }
};

struct AxisValue {
  std::string label;  // in table and chart; without commas and quotes
  World world;
  bool quick = true;  // also a part of the quick study
};

struct StabilityAxis {
  std::string name;     // within its kind
  std::string title;    // with the unit
  bool matched = true;  // trained and tested there; else trained at the base, tested there
  std::vector<AxisValue> values;  // in order; one of them is the base

  std::string kind() const { return matched ? "matched" : "shifted"; }
  std::string id() const { return kind() + "-" + name; }
  std::size_t base() const;  // which of the values
};

// All axes with all their values, or with those of the quick study. Throws Error(failed) if the
// base lacks a setting, or is none of an axis' values.
std::vector<StabilityAxis> stability_axes(const BaseCondition& base, bool quick);

// As the world has it: gain, lost sensors.
void apply(const World& world, Dataset& data);

}  // namespace echofuse::recon
