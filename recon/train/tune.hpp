// SPDX-License-Identifier: MIT
// Tuning makes a model of another room from a model and a few records of that room.
// Cross-validation within the records compares four outcomes: the old model unchanged; with
// background and position corrected; fine-tuned, with an L2 penalty to its weights that the
// cross-validation also chooses; and a model of these records alone. Takes the best start of
// several old models.
#pragma once
#include <string>
#include <vector>

#include "recon/train/crossvalidate.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {

struct TuneOptions {
  static constexpr std::size_t least_records = 10;
  static constexpr std::size_t least_alone = 50;  // fewer records make no model of their own
  SplitOptions split;                             // no validation records, which nothing uses
  Tuning tuning;                                  // its penalty is chosen
  bool quiet = true;                              // false: names the candidates on stderr
  std::string only = {};  // the one row of the table that is tried; empty: all are
};

// A model to start from, and the records as match_for_tuning has made them for it. Also the same
// records on their own axes, with one response, for a model of these alone.
struct Start {
  const TrainedModel& model;
  const Dataset& data;
  const Dataset& own;
  std::string name = {};  // in the table, if there are several
};

struct TunedModel {
  TrainedModel model;
  std::vector<CrossvalidatedRow> table;  // the models that were tried
  std::size_t chosen = 0;                // row of the table
  std::string left_out;                  // as of TrainingRows, by the first start
  std::string starts;                    // difference between the starts; empty with one
};

// Brings the data onto the model's axes and to its response. `path` is the model's. Throws
// Error(failed) that names what does not fit.
void match_for_tuning(const TrainedModel& from, const std::string& path, Dataset& data);

// Tunes from the start whose outcome has the best score. All starts have the same records. With few
// records the old model stays unless an outcome is plainly better within its start. Throws
// Error(failed) for fewer than least_records records, or a kind that cannot be tuned.
TunedModel tune(const std::vector<Start>& starts, const TuneOptions& options);

// Returns one line for each row of the table: accuracy, and which is chosen.
std::string to_text(const TunedModel& tuned);

}  // namespace echofuse::recon
