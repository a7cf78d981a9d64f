// SPDX-License-Identifier: MIT
// Takes a model from the room of its training to another room, by a run without people made there.
// Exchanges the static echoes and light of both rooms in histogram, profile and antennas' lags. The
// maps show the new walls.
#pragma once
#include <string>

#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

// Returns the mean of the records of `empty`, a run without people on its own axes. Dead and
// doubtful records are left out and counted. Throws Error(failed) if fewer than five have all
// sensors of these data, or if people are in the run.
EmptyRoom empty_room_of(const Dataset& empty, const std::string& path);

// Changes the model's estimators by the run without people at `path`. Returns a text for the user,
// or nothing. Without depth maps in the run, the maps keep the walls of the training. Subtracts
// `range_offset_m` from the radar's ranges of that run, as prepare_records does. Throws
// Error(failed) if the axes are not the model's or no record has its sensors. Throws it also if
// people are in the run, or the model does not place a body.
std::string take_to_room(TrainedModel& model, const std::string& path, double range_offset_m = 0);

// States the room of the records, before a training. Returns a text that counts the records left
// out, or nothing. Throws Error(failed) if the axes differ, or as empty_room_of().
std::string state_empty_room(Dataset& data, const std::string& path);

// Turns the radar's values into those that it would have seen in the room of the training. `data`
// is on the model's axes. The histogram stays, because its scatter belongs to its counts.
void exchange_room(const EmptyRoom& change, Dataset& data);

}  // namespace echofuse::recon
