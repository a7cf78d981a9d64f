// SPDX-License-Identifier: MIT
// From a model and a few records of another room to a model of that room. How far the old model is
// to be trusted is found by cross-validation within the records: the model as it was, tuned with a
// stronger or weaker pull to its old weights, or a model of these records alone.
#pragma once
#include <string>
#include <vector>

#include "recon/estimator/crossvalidate.hpp"
#include "recon/estimator/train.hpp"

namespace echofuse::recon {

struct TuneOptions {
  static constexpr std::size_t least_records = 10;
  static constexpr std::size_t least_alone = 50;  // fewer make no model of their own
  SplitOptions split;  // without validation records, which nothing asks for
  Tuning tuning;       // its pull is chosen
};

struct TunedModel {
  TrainedModel model;
  std::vector<CrossvalidatedRow> table;  // what was tried
  std::size_t chosen = 0;                // of the table
};

// Brings the data onto axes that the tuned model can have: the model's own, or other ones that
// nowhere lie further than a bin from them. `path`: of the model. Throws Error(failed) that names
// what does not fit.
void match_for_tuning(const TrainedModel& from, const std::string& path, Dataset& data);

// Of data that match_for_tuning has seen. `from` must be of a kind that can be tuned; else, and for
// fewer than least_records records, throws Error(failed).
TunedModel tune(const TrainedModel& from, const Dataset& data, const TuneOptions& options);

// One line a row of the table: accuracy, and which is chosen.
std::string to_text(const TunedModel& tuned);

}  // namespace echofuse::recon
