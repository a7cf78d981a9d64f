// SPDX-License-Identifier: MIT
// What a laboratory's records have in common without their labels: means and spreads of what each
// of them shows (domain_shift.hpp), where people stand apart. A model that was trained on many
// laboratories takes it as inputs beside each record, so that one network fits people, clothes and
// sensors of all of them. Of a run whose laboratory is not known every number is 0.
#pragma once
#include <vector>

#include "recon/data/dataset.hpp"
#include "recon/models/body/alignment.hpp"

namespace echofuse::recon {

// The rows of each laboratory of which a run has many records, as its meta data say: record i is of
// laboratory i modulo `laboratories`. Empty if there are fewer than 50 with 10 records each.
std::vector<Rows> laboratories_of(const Dataset& data, const Rows& rows);

class RunContext {
 public:
  RunContext() = default;  // of models that take none
  // What laboratories differ in, and what each record of them is to be trained with: the context of
  // 5 to 40 of its laboratory's records, drawn anew, or nothing known (three in ten). One row a
  // record of the data; row i of the aligned features is of record i. All zero for other records.
  RunContext(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
             const std::vector<Rows>& laboratories, Inputs inputs, std::uint64_t seed,
             Matrix& trained_with);

  std::size_t size() const { return value_.size(); }
  // From now on that of these records; as it was if none of them shows a body.
  void learn(const Alignment& alignment, const Dataset& data, const Matrix& aligned,
             const Rows& rows, Inputs inputs);
  // Before every row of a table.
  Matrix before(const Matrix& table) const;
  static Matrix before(const Matrix& table, const Matrix& contexts);

  void save(record::H5File& file) const;  // below "context/"
  void load(const record::H5File& file);

 private:
  std::vector<float> standardised(const std::vector<double>& found) const;
  std::vector<double> usual_, deviation_;  // over the laboratories
  std::vector<float> value_;
};

}  // namespace echofuse::recon
