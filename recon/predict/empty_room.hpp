// SPDX-License-Identifier: MIT
// Adapts a model to another room by means of a run of that room without people. In histogram,
// profile and antenna lags, static echoes and light of the training room are replaced by those of
// the new room. Predicted maps then show the walls of the new room.
#pragma once
#include <string>

#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

// Returns the mean over the records of `empty`, a run without people, on the run's own axes.
// Excludes and counts dead and doubtful records. Throws Error(failed) if fewer than five records
// have all sensors of the run, or if the counts indicate people in the room.
EmptyRoom empty_room_of(const Dataset& empty, const std::string& path);

// Adapts the estimators of the model to the empty room recorded at `path`. Returns notes for the
// user; may be empty. If the run has no depth maps, predicted maps keep the walls of the training
// room. Subtracts `range_offset_m` from the run's radar ranges, like prepare_records(). Throws
// Error(failed) if run and model have different axes, no record has all sensors of the model,
// people are in the run, or the model does not place a body.
std::string adapt_to_room(TrainedModel& model, const std::string& path, double range_offset_m = 0);

// Reads the run of the empty room at `path` and stores its mean in data.empty_room, for training.
// Returns a text with the number of excluded records; may be empty. Throws Error(failed) if the
// axes differ, or like empty_room_of().
std::string state_empty_room(Dataset& data, const std::string& path);

// Corrects the radar values of records from the new room, so that static echoes match those of the
// training room. `data` must be on the model's axes. Does not correct the histogram, because its
// noise depends on the recorded counts.
void exchange_room(const EmptyRoom& change, Dataset& data);

}  // namespace echofuse::recon
