// SPDX-License-Identifier: MIT
// Whether a run as a whole is unlike the training, where no single record need be: people, clothes
// or sensors differ. Each record says some numbers that depend on no gain (observables); the means
// of a run, and of the squares, are held against those of training records. The test is Hotelling's
// two-sample T^2 (Ann. Math. Stat. 2, 360, 1931) with the training's covariance, next to the
// greatest single difference; how large either may be by chance is found by resampling the training
// records in circular blocks (Politis and Romano 1992), as a pose may be held for some records.
//
// Limit: what moves no observable is invisible, such as another gain, or a shift common to both
// sensors that is small against the span of the ranges.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"

namespace echofuse::recon {

struct DomainShift {
  static constexpr double most_p = 1e-3;  // below it the run is called unlike the training
  struct Difference {
    std::string text;  // "histogram spread 1.2 times"
    double deviations = 0;
  };
  std::size_t records = 0;  // that show a body; too few: not tested
  double distance = 0;      // in units of what 95 % of such runs of the training's kind stay below
  double p = 1;             // of a run of the training's kind to be as far off
  std::vector<Difference> differences;  // that stand out, the clearest first
  bool tested() const { return records > 0; }
  bool found() const { return tested() && p < most_p; }
  std::string text() const;  // for the user; empty if not tested
};

// What the training records said.
class DomainReference {
 public:
  static constexpr std::size_t least_records = 20;

  DomainReference() = default;
  // The rows in the order of their records; at most the first 2000 of them. Row i of the aligned
  // features is of record i of the data; without a detector there are none.
  DomainReference(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
                  const Rows& rows, Inputs inputs);
  bool known() const { return seen_.rows > 0; }
  // Of the rows with live sensors, in their order. The data must be on the model's axes.
  DomainShift judge(const Alignment& alignment, const Dataset& data, const Matrix& aligned) const;

  void archive(Archive archive, Inputs inputs);

 private:
  Inputs inputs_{};
  Matrix seen_;  // observables, one row a record
};

}  // namespace echofuse::recon
