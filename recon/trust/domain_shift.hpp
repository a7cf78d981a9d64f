// SPDX-License-Identifier: MIT
// Tests whether a run as a whole differs from the training data (other people, clothes or sensors),
// even if no single record does. Compares the numbers that describe a record (record_numbers.hpp)
// with those of the training records (numbers/permutation_test.hpp). Limit: the test cannot detect
// a change that affects none of the numbers, such as a different gain, or a small range bias of
// both sensors. Static echoes show a difference between their biases (static_echoes.hpp).
#pragma once
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"
#include "recon/trust/record_numbers.hpp"
#include "recon/trust/static_echoes.hpp"

namespace echofuse::recon {

struct DomainShift {
  static constexpr double max_p = 1e-3;  // limit of the p-value of a difference
  struct Difference {
    std::string text;            // e.g. "histogram spread 1.20 +- 0.01 times that in training"
    double standard_errors = 0;  // difference divided by its standard error
    std::string advice{};        // possible cause and remedy; may be empty
  };
  std::size_t records = 0;  // that show a body; 0: too few for a test
  double p = 1;  // probability that a run like the training data differs by at least this much
  // Significant differences of at least a tenth of the deviation between records, largest first.
  std::vector<Difference> differences{};
  // Number of records tested individually, number of those flagged, and the most frequent reason.
  std::size_t assessed = 0, flagged = 0;
  std::string reason{};
  // Factor by which the 90 % intervals of the run's records are widened: 1, or 1.05 to 10.
  double interval_factor = 1;
  std::string range_difference{};  // significant difference of the static echoes; may be empty
  bool tested() const { return records > 0 || mostly_flagged() || !range_difference.empty(); }
  // Returns true if the run differs from the training data.
  bool found() const {
    return mostly_flagged() || (p < max_p && !differences.empty()) || !range_difference.empty();
  }
  bool mostly_flagged() const;  // usually, about one in 250 records is flagged
  std::string text() const;     // message for the user; empty if the run was not tested
};

// Statistics of the training records, against which a run is tested.
class DomainReference {
 public:
  // Minimum number of records of a run, and of training records.
  static constexpr std::size_t min_records = 20, min_known = 50;

  DomainReference() = default;
  // The rows must be in record order; at most the first 4000 are used. Row i of `views` belongs to
  // record i of `data`; `views` is empty if the SPD is missing.
  DomainReference(const Alignment& alignment, const Dataset& data, const Matrix& views,
                  const Rows& rows, Inputs inputs);
  bool known() const { return numbers_.rows > 0; }
  // Tests a run, using all rows that have the required sensors, in record order. The data must be
  // on the axes of the model.
  DomainShift test(const Alignment& alignment, const Dataset& data, const Matrix& views) const;

  void archive(Archive archive, Inputs inputs, const Layout& layout);

 private:
  Inputs inputs_{};
  Matrix numbers_;  // [records x run_numbers]
  StaticEchoes echoes_;
};

}  // namespace echofuse::recon
