// SPDX-License-Identifier: MIT
// Adapts a model to another room, with a run of that room without people. Replaces static echoes
// and light of the training room in histogram, profile and antenna lags. Maps then show the new
// walls.
#pragma once
#include <string>

#include "recon/predict/trained_model.hpp"

namespace echofuse::recon {

// Returns the mean of the records of `empty`, a run without people, on its own axes. Leaves out and
// counts dead and doubtful records. Throws Error(failed) if fewer than five have all sensors of
// these data, or if people are in the run.
EmptyRoom empty_room_of(const Dataset& empty, const std::string& path);

// Adapts the model's estimators to the empty room recorded at `path`. Returns a note for the user,
// or nothing. If the run has no depth maps, maps keep the walls of the training. Subtracts
// `range_offset_m` from the run's radar ranges, like prepare_records(). Throws Error(failed) if the
// axes differ from the model's, no record has its sensors, people are in the run, or the model does
// not place a body.
std::string adapt_to_room(TrainedModel& model, const std::string& path, double range_offset_m = 0);

// Sets the empty room of the records before a training. Returns a text that counts the records left
// out, or nothing. Throws Error(failed) if the axes differ, or like empty_room_of().
std::string state_empty_room(Dataset& data, const std::string& path);

// Converts the radar's values to those in the training room. `data` must be on the model's axes.
// Does not change the histogram, because its noise depends on its counts.
void exchange_room(const EmptyRoom& change, Dataset& data);

}  // namespace echofuse::recon
