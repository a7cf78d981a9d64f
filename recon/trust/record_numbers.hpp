// SPDX-License-Identifier: MIT
// Numbers that describe a record, independent of gains, for the comparison of runs
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
  Kind kind;     // ratio: logarithm; length: metres
  double floor;  // least deviation, for a number that is constant in the training
};
// Four numbers of the detector, four of the radar, and the difference of their ranges.
inline constexpr std::size_t record_number_count = 9, radar_range_number = 8;
extern const std::array<RecordNumber, record_number_count> record_numbers;

// Returns [m x record_number_count], one row for each of `rows` that shows a body. NaN: unknown,
// e.g. for a sensor that is not an input. Row i of the views belongs to record i of the data;
// without a detector the views have no columns.
Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs);

// Returns a profile's peak over the standard deviation of its weaker half.
float peak_to_noise(std::span<const float> power);

}  // namespace echofuse::recon
