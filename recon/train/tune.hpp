// SPDX-License-Identifier: MIT
// Adapts a model to another room with a few records from that room. Compares four kinds of
// candidates by cross-validation on these records: the old model unchanged; the old model with
// corrected background and position; the fine-tuned model, with several L2 penalties; and a model
// trained on these records alone. If there are several old models, the best start is used.
#pragma once
#include <string>
#include <vector>

#include "recon/train/crossvalidate.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {

struct TuneOptions {
  static constexpr std::size_t min_records = 10;
  // Minimum number of new records that are required to try a model trained only on them.
  static constexpr std::size_t min_records_alone = 50;
  SplitOptions split;     // has no validation records, because tuning does not use them
  Tuning tuning;          // its penalty is replaced by the cross-validated penalty
  bool quiet = true;      // false: print each candidate on stderr
  std::string only = {};  // name of the only candidate to try; if empty, all are tried
};

// A model to start from. `data`: records on the axes of the model (match_for_tuning). `own`: the
// same records on their own axes, all with the same radar response, for training a model only on
// these records.
struct Start {
  const TrainedModel& model;
  const Dataset& data;
  const Dataset& own;
  std::string name = {};  // prefix of this model's table rows, if there are several start models
};

struct TunedModel {
  TrainedModel model;
  std::vector<CrossvalidatedRow> table;  // one row per candidate
  std::size_t chosen = 0;                // row of the chosen candidate
  std::string left_out;                  // TrainingRows::left_out of the first start model
  std::string starts;  // comparison of the start models; empty if there is only one
};

// Converts the data to the axes and the radar response of a model. `path`: path of the model, for
// messages. Throws Error(failed) if the data lack a sensor of the model, or if their axes or map
// grid do not match those of the model.
void match_for_tuning(const TrainedModel& from, const std::string& path, Dataset& data);

// Tunes each start model and returns the best result. All entries of `starts` must contain the same
// records. If there are few records, the old model is kept unless a candidate is clearly better.
// Throws Error(failed) if there are fewer than `min_records` records, or if this kind of model
// cannot be tuned.
TunedModel tune(const std::vector<Start>& starts, const TuneOptions& options);

// Returns one line with the accuracy for each row of the table, and marks the chosen candidate. The
// comparison of the start models follows.
std::string to_text(const TunedModel& tuned);

}  // namespace echofuse::recon
