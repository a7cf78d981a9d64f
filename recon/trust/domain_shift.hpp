// SPDX-License-Identifier: MIT
// Tests whether a run as a whole differs from the training data, even if no single record does:
// other people, clothes or sensors. Compares the means of the records' numbers
// (record_numbers.hpp), and of their squares, with those of training records. The permutation test
// takes the greatest difference in units of its standard deviation (Westfall and Young,
// Resampling-Based Multiple Testing, 1993; Good, Permutation Tests, 2000). It exchanges blocks of
// ten records, because a pose may last for several records.
//
// Limit: cannot detect a change that affects none of the numbers, such as another gain, or a range
// bias common to both sensors that is small against the span of the ranges.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"
#include "recon/trust/record_numbers.hpp"

namespace echofuse::recon {

struct DomainShift {
  static constexpr double most_p = 1e-3;  // limit of p; below it the run differs
  struct Difference {
    std::string text;            // "histogram spread 1.20 +- 0.01 times"
    double standard_errors = 0;  // significance of the difference
  };
  std::size_t records = 0;              // records that show a body; 0 if too few for a test
  double p = 1;                         // p-value: probability that a run like the training differs
                                        // by at least this much
  std::vector<Difference> differences;  // significant differences, greatest first
  std::string advice;                   // the possible cause and what to do; may be empty
  // Records tested one by one, and those flagged as out of distribution; `reason` is the most
  // frequent.
  std::size_t judged = 0, flagged = 0;
  std::string reason{};
  bool tested() const { return records > 0 || mostly_flagged(); }
  // A significant difference must also exceed a tenth of the standard deviation between records.
  bool found() const { return mostly_flagged() || (p < most_p && !differences.empty()); }
  // Returns true if most records are flagged; among records like the training, one in 140 is
  // flagged.
  bool mostly_flagged() const;
  std::string text() const;  // for the user; empty if not tested
};

// Numbers of the training records, as reference for the test of runs.
class DomainReference {
 public:
  static constexpr std::size_t least_records = 20;  // needed in a run
  static constexpr std::size_t least_known = 50;    // needed in a training

  DomainReference() = default;
  // The rows are in the order of the records; at most the first 4000 are used. Row i of the views
  // belongs to record i of the data; without a detector the views are empty.
  DomainReference(const Alignment& alignment, const Dataset& data, const Matrix& views,
                  const Rows& rows, Inputs inputs);
  bool known() const { return numbers_.rows > 0; }
  // Tests the rows with live sensors, in order. The data must be on the model's axes.
  DomainShift test(const Alignment& alignment, const Dataset& data, const Matrix& views) const;

  void archive(Archive archive, Inputs inputs);

 private:
  Inputs inputs_{};
  Matrix numbers_;  // one row per record
};

}  // namespace echofuse::recon
