// SPDX-License-Identifier: MIT
// Numbers that describe a record, independent of gains, in one table. The test of a run compares
// the means of the first nine with those in training (domain_shift.hpp). The others flag a record
// if they exceed a limit learnt from training records (out_of_distribution.hpp).
#pragma once
#include <array>
#include <cmath>
#include <string>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"
#include "recon/numbers/components.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {

// Measurements of one record. NaN: unknown, e.g. because a sensor is not an input.
struct RecordValues {
  double empty = 0;  // 1: the SPD detects no body
  double range_m = NAN, clicks_per_pulse = NAN;
  double displacement_m = NAN;  // range of the radar minus range of the SPD
  Moments histogram, profile;   // around the body; of the whole profile if the SPD is missing
  double background = NAN;      // fraction of the clicks
  double peak_to_noise = NAN, power_before = NAN;  // profile beyond the leakage
  ComponentDistances::Values distances;            // from the training records
  double two_bodies = NAN;                         // log odds of two bodies
};

// How a number describes a run.
struct RunNumber {
  // ratio: the number is a logarithm; length: the number is in metres
  enum class Kind : std::uint8_t { ratio, length, number } kind = Kind::number;
  double floor = 0;     // minimum standard deviation, for a number that is constant in training
  double widening = 0;  // widening of the 90 % intervals per standard deviation
  // Possible cause and remedy of a difference; may be null.
  std::string (*advice)(double difference, double standard_error) = nullptr;
};

struct RecordNumber {
  const char* name;  // in the run line, or reason of the flag
  double (*of)(const RecordValues&);
  RunNumber in_run{};
  const char* advice = "";     // remedy if most records have this flag; may be empty
  const char* unit = nullptr;  // not null: the number is stated next to the flag
};

// The table contains the numbers of a run, three flags that are checked first, the squared
// distances of the groups of OutOfDistributionDetector, T^2 and the log odds of two bodies.
inline constexpr std::size_t run_numbers = 9, radar_range_number = 8, first_learnt = 12,
                             record_number_count = 20;
extern const std::array<RecordNumber, record_number_count> record_numbers;

// Returns a table [m x run_numbers] of those of `rows` that show a body. NaN: unknown. Row i of
// `views` belongs to record i of `data`; `views` has no columns if the SPD is missing.
Matrix record_numbers_of(const Alignment& alignment, const Dataset& data, const Matrix& views,
                         const Rows& rows, Inputs inputs);

}  // namespace echofuse::recon
