// SPDX-License-Identifier: MIT
// Adapts a model to another room with a few records from there. Compares four candidates by
// cross-validation on these records: the old model unchanged; with background and position
// corrected; fine-tuned, with an L2 penalty that cross-validation chooses too; and a model of these
// records alone. Given several old models, it takes the best start.
#pragma once
#include <string>
#include <vector>

#include "recon/train/crossvalidate.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {

struct TuneOptions {
  static constexpr std::size_t least_records = 10;
  static constexpr std::size_t least_alone = 50;  // below, no model of these records alone
  SplitOptions split;                             // without validation records, which are not used
  Tuning tuning;                                  // its penalty is chosen by cross-validation
  bool quiet = true;                              // false: print the candidates on stderr
  std::string only = {};                          // try this row of the table only; empty: all
};

// A model to start from, and the records after match_for_tuning() for it. Also the same records on
// their own axes, with one response, for a model of these alone.
struct Start {
  const TrainedModel& model;
  const Dataset& data;
  const Dataset& own;
  std::string name = {};  // prefix in the table if there are several starts
};

struct TunedModel {
  TrainedModel model;
  std::vector<CrossvalidatedRow> table;  // the models tried
  std::size_t chosen = 0;                // row of the table
  std::string left_out;                  // TrainingRows::left_out, for the first start
  std::string starts;                    // comparison of the starts; empty if there is one
};

// Brings the data to the model's axes and response. `path` is the model's. Throws Error(failed) if
// they do not fit.
void match_for_tuning(const TrainedModel& from, const std::string& path, Dataset& data);

// Tunes each start and returns the best result. All starts have the same records. With few records
// the old model stays unless a candidate is clearly better. Throws Error(failed) for fewer than
// least_records records, or a kind that cannot be tuned.
TunedModel tune(const std::vector<Start>& starts, const TuneOptions& options);

// Returns one line for each row of the table: accuracy, and which is chosen.
std::string to_text(const TunedModel& tuned);

}  // namespace echofuse::recon
