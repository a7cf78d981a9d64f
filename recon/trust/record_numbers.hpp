// SPDX-License-Identifier: MIT
// Numbers that describe a record, independent of gains. These numbers are used to compare runs
// (domain_shift.hpp).
#pragma once
#include <array>
#include <span>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"

namespace echofuse::recon {

struct RecordNumber {
  enum class Kind : std::uint8_t { ratio, length, number };
  const char* name;
  Kind kind;  // ratio: the number is a logarithm; length: the number is in metres
  // Lower limit of the standard deviation, for a number that is constant in the training data.
  double floor;
  // Widening of the 90 % intervals per standard deviation by which the mean of a run differs.
  double widening = 0;
};
// A record is described by four numbers of the SPD, four numbers of the radar, and the difference
// between the ranges of the two sensors.
inline constexpr std::size_t record_number_count = 9, radar_range_number = 8;
extern const std::array<RecordNumber, record_number_count> record_numbers;

// Returns a table [m x record_number_count], with one row for each record in `rows` that shows a
// body. A number is NaN if it is unknown, e.g. because the sensor is not an input. Row i of `views`
// belongs to record i of `data`; `views` has no columns if the SPD is missing.
Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs);

// Returns the profile of a row without the range bins that may contain transmitter leakage, or the
// whole profile if fewer than three bins would remain.
std::span<const float> beyond_leakage(const Column& profiles, std::size_t row);
// Returns the height of a profile's peak above the mean of its weaker half, divided by the standard
// deviation of that half.
float peak_to_noise(std::span<const float> power);

}  // namespace echofuse::recon
