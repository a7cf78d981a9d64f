// SPDX-License-Identifier: MIT
// Columns of a data set: the values of the sensors, one row per record, with their axes.
#pragma once
#include <algorithm>
#include <charconv>
#include <cstdint>
#include <string>
#include <utility>

#include "drivers/core/axis.hpp"
#include "drivers/core/sensor.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

// Returns the number of lags of an axis (data/lags.hpp) that belong to vertical antenna pairs; they
// follow the horizontal ones. The number is part of the axis quantity: "lags" (none), or "lags, 3
// up".
inline std::size_t lags_up(const Axis& lags) {
  const std::size_t comma = std::min(lags.quantity.find(", "), lags.quantity.size());
  std::size_t out = 0;
  std::from_chars(lags.quantity.data() + std::min(comma + 2, lags.quantity.size()),
                  lags.quantity.data() + lags.quantity.size(), out);
  return out;
}

// Axis of a column. A row contains the bins of the first zone, then those of the second zone, and
// so on.
struct ColumnAxis : Axis {
  ColumnAxis(Axis axis = {}) : Axis(std::move(axis)) {}
  // A bin of the axis "array" contains c_0 and the real and imaginary parts of `scale` further lags
  // (data/lags.hpp).
  std::size_t values_per_bin() const {
    return name == "array" ? 2 * static_cast<std::size_t>(scale) + 1 : 1;
  }
  std::size_t zone_size() const { return count * values_per_bin(); }
  std::size_t size() const { return zones.size() * zone_size(); }
};

// Effect of fewer photons or frames on the values of a column: Poisson counts, power with
// exponential noise, or lags of the same frames as the power.
enum class Noise : std::uint8_t { none, counts, power, lags };

// Values of a sensor, one row per record. If the sensor is missing in a record, its row contains
// zeros.
struct Column : Matrix {
  Sensor sensor;
  Noise noise;
  // Its count is 0 if the runs do not have the sensor, or if the sensor was not loaded.
  ColumnAxis axis = {};
  // The column was removed, because the axes of the runs differ (only "array").
  bool differs = false;

  using Matrix::operator=;
};

// Columns of an observation of a model, in this order: photons per bin, summed over the zones;
// radar power; spatial lags; and, if there are several zones, photons per bin of each zone.
template <class T>
struct ObservationParts {
  std::span<T> counts, power, lags, zones;
};

// Condition of Layout::shows_sides(), for messages.
inline const std::string needs_of_sides = "both sensors, or a detector with zones";

// Axes of the sensors that a model uses; an axis has count 0 if its sensor is not used.
struct Layout {
  ColumnAxis spd = {}, radar = {}, array = {};

  std::size_t zones_size() const { return spd.zones.size() > 1 ? spd.size() : 0; }
  // Returns true if left and right can be distinguished: by the difference between the ranges of
  // two sensors, or by the zones of the detector.
  bool shows_sides() const { return spd.count > 0 && (radar.count > 0 || zones_size() > 0); }
  // Returns the number of values of an observation.
  std::size_t inputs() const { return spd.count + radar.size() + array.size() + zones_size(); }
  template <class T>
  ObservationParts<T> parts(std::span<T> observation) const {
    return {observation.first(spd.count), observation.subspan(spd.count, radar.size()),
            observation.subspan(spd.count + radar.size(), array.size()),
            observation.last(zones_size())};
  }
};

void archive(Archive archive, Layout& axes);

}  // namespace echofuse::recon
