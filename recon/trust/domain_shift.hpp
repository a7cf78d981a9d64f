// SPDX-License-Identifier: MIT
// Test whether a run as a whole is unlike the training, where no single record need be: people,
// clothes or sensors differ. The means of the records' numbers (record_numbers.hpp), and of their
// squares, are compared with those of training records by a permutation test of the greatest
// difference in units of its own scatter (Westfall and Young, Resampling-Based Multiple Testing,
// 1993; Good, Permutation Tests, 2000). Blocks of ten records, as a pose may be held for some, are
// exchanged between run and training.
//
// Limit: a change that moves no number is invisible, such as another gain, or a shift common to
// both sensors that is small against the span of the ranges.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"
#include "recon/trust/record_numbers.hpp"

namespace echofuse::recon {

struct DomainShift {
  static constexpr double most_p = 1e-3;  // below it the run is called unlike the training
  struct Difference {
    std::string text;            // "histogram spread 1.20 +- 0.01 times"
    double standard_errors = 0;  // clarity of the difference
  };
  std::size_t records = 0;  // records that show a body; with too few the run is not tested
  double p = 1;             // probability that a run like the training is as far off
  std::vector<Difference> differences;  // the differences that stand out, the clearest first
  std::string advice;                   // the possible cause and what to do; may be empty
  // Records judged one by one, and those flagged as unlike the training, most of them for `reason`.
  std::size_t judged = 0, flagged = 0;
  std::string reason{};
  bool tested() const { return records > 0 || mostly_flagged(); }
  // A sure difference does not count if it is less than a tenth of the records' own differences.
  bool found() const { return mostly_flagged() || (p < most_p && !differences.empty()); }
  // A run is no more like the training than its records, of which about one in 140 is flagged.
  bool mostly_flagged() const;
  std::string text() const;  // for the user; empty if not tested
};

// Numbers of the training records, against which runs are tested.
class DomainReference {
 public:
  static constexpr std::size_t least_records = 20;  // least records of a run
  static constexpr std::size_t least_known = 50;    // least records of a training

  DomainReference() = default;
  // The rows are in the order of their records; at most the first 4000 are used. Row i of the views
  // belongs to record i of the data; without a detector there are no views.
  DomainReference(const Alignment& alignment, const Dataset& data, const Matrix& views,
                  const Rows& rows, Inputs inputs);
  bool known() const { return numbers_.rows > 0; }
  // Tests the rows with live sensors, in their order. The data must be on the model's axes.
  DomainShift judge(const Alignment& alignment, const Dataset& data, const Matrix& views) const;

  void archive(Archive archive, Inputs inputs);

 private:
  Inputs inputs_{};
  Matrix numbers_;  // one row a record
};

}  // namespace echofuse::recon
