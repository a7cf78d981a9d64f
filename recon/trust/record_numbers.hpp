// SPDX-License-Identifier: MIT
// Numbers that a record tells of itself and that depend on no gain: what runs are compared by
// (domain_shift.hpp), and of a single record the variation of its radar's power
// (out_of_distribution.hpp).
#pragma once
#include <array>
#include <optional>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"

namespace echofuse::recon {

struct RecordNumber {
  enum class Kind : std::uint8_t { ratio, length, number };
  const char* name;
  Kind kind;           // ratio: the number is a logarithm; length: metres
  double floor;        // of its deviation: what is constant in a training may vary so much
  bool radar_range{};  // moves with an offset of the radar's ranges
};
// Of the detector first, then of the radar, of both, and of the radar's power over time.
std::vector<RecordNumber> record_numbers(Inputs inputs);

// [m x numbers]: a row for each of the rows that shows a body. NaN: not known. Row i of the views
// is of record i of the data; without a detector the views have no columns.
Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs);

// How the radar's power varies within a record, as logarithms (acquire/record/speckle.hpp): from
// frame to frame, from carrier to carrier, within 150 ms. NaN: not known, as of older runs.
inline constexpr std::size_t power_variations = 3;
std::array<double, power_variations> log_power_variations(const std::optional<record::Speckle>&);
double power_variation(double log, std::size_t which);  // its inverse
extern const std::array<RecordNumber, power_variations> power_variation_numbers;

}  // namespace echofuse::recon
