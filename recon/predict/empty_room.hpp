// SPDX-License-Identifier: MIT
// Adapts a model to another room by means of a run of that room without people. In the histogram,
// the range profile and the antenna lags, the static echoes and background light of the training
// room are replaced by those of the new room. Predicted maps then show the walls of the new room.
#pragma once
#include <string>

#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

struct EmptyRoom {
  Dataset records;       // records of a run without people
  std::string left_out;  // states how many records were excluded; may be empty
};

// Returns the records of `empty`, a run recorded without people. Excludes and counts dead and
// doubtful records. Throws Error(failed) if fewer than five records contain valid data from all
// sensors of the run, or if the counts indicate that people were in the room.
EmptyRoom empty_room_of(const Dataset& empty, const std::string& path);

// Adapts the model's estimators to the empty room recorded at `path`. Returns notes for the user;
// may be empty. If the run has no depth maps, predicted maps keep the walls of the training room.
// Subtracts `range_offset_m` from the run's radar ranges, like prepare_records(). Throws
// Error(failed) if the axes of the run and the model differ, no record contains data from all
// sensors of the model, the run shows people, or the model does not predict a body position.
std::string adapt_to_room(TrainedModel& model, const std::string& path, double range_offset_m = 0);

// Reads the empty-room run at `path`, for training on `data`. Throws Error(failed) if its axes
// differ from those of `data`, and in the cases listed for empty_room_of().
EmptyRoom load_empty_room(const Dataset& data, const std::string& path);

// Corrects the radar values of records from the new room, so that static echoes match those of the
// training room. `change`: columns with one row, or none; `data` must be on the model's axes. Does
// not correct the histogram, because its noise depends on the recorded counts.
void exchange_room(const std::vector<Column>& change, Dataset& data);

}  // namespace echofuse::recon
