// SPDX-License-Identifier: MIT
// Tests whether a run as a whole differs from the training data (other people, clothes or sensors),
// even if no single record does. Compares the means of the numbers that describe a record
// (record_numbers.hpp), and of their squares, with those of the training records. The permutation
// test uses the largest difference in units of its standard deviation (Westfall and Young,
// Resampling-Based Multiple Testing, 1993; Good, Permutation Tests, 2000). It exchanges blocks of
// ten records, because a pose may last for several records.
//
// Limit: the test cannot detect a change that affects none of the numbers, such as a different
// gain. Nor can it detect a range bias of both sensors that is small compared with the span of the
// ranges. Static echoes show a difference between the biases of the two sensors
// (static_echoes.hpp).
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/method/alignment.hpp"
#include "recon/trust/record_numbers.hpp"
#include "recon/trust/static_echoes.hpp"

namespace echofuse::recon {

struct DomainShift {
  // The run counts as different from the training data if p is below this limit.
  static constexpr double max_p = 1e-3;
  struct Difference {
    std::string text;            // e.g. "histogram spread 1.20 +- 0.01 times that in training"
    double standard_errors = 0;  // difference divided by its standard error
  };
  // Number of records that show a body, or 0 if they are too few for a test.
  std::size_t records = 0;
  // P-value: probability that a run that resembles the training data would differ by at least this
  // much.
  double p = 1;
  std::vector<Difference> differences{};  // significant differences, the largest first
  std::string advice{};                   // possible cause and remedy; may be empty
  // Number of records tested individually, and number of those flagged as out of distribution.
  // `reason`: the most frequent reason.
  std::size_t assessed = 0, flagged = 0;
  std::string reason{};
  // Factor by which the 90 % intervals of the run's records are widened: 1, or 1.05 to 10.
  // Increases with the differences that enlarge the lateral error.
  double interval_factor = 1;
  // Range difference that the static echoes show; empty if it is not significant.
  std::string range_difference{};
  bool tested() const { return records > 0 || mostly_flagged() || !range_difference.empty(); }
  // Returns true if the run differs from the training data. A significant difference must also
  // exceed a tenth of the standard deviation between records.
  bool found() const {
    return mostly_flagged() || (p < max_p && !differences.empty()) || !range_difference.empty();
  }
  // Returns true if most records are flagged. About one in 250 records that resemble the training
  // data is flagged.
  bool mostly_flagged() const;
  std::string text() const;  // message for the user; empty if the run was not tested
};

// Statistics of the training records, against which a run is tested.
class DomainReference {
 public:
  // Minimum number of records in a run to be tested.
  static constexpr std::size_t min_records = 20;
  static constexpr std::size_t min_known = 50;  // minimum number of training records

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
  // `range_matters`: the radar's range is a difference that an offset may cause.
  DomainShift test_numbers(const Matrix& found, bool range_matters) const;

  Inputs inputs_{};
  Matrix numbers_;  // [records x record_number_count]
  StaticEchoes echoes_;
};

}  // namespace echofuse::recon
