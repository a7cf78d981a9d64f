// SPDX-License-Identifier: MIT
// A model that was trained in one room is taken to another one, of which there are records of
// nobody. The echoes and light of what stands still there are exchanged for those in training, in
// the histogram, the profile and the antennas' lags, and the maps show the new walls.
#pragma once
#include <string>

#include "recon/use/trained_model.hpp"

namespace echofuse::recon {

// It takes a run without people, on its own axes, and returns the mean of its records. Throws
// Error(failed) if fewer than five records have all sensors that these data have, or if people are
// in the run.
EmptyRoom empty_room_of(const Dataset& empty, const std::string& path);

// `path` names a run without people. It changes the model's estimators, and returns a text for the
// user, or nothing. If the run has no depth maps, the maps show the walls of the training. The
// range offset is taken off the run's radar as off the records' (prepare_records). Throws
// Error(failed) if the axes are not the model's, no record has its sensors, people are in it, or
// the model does not place a body.
std::string take_to_room(TrainedModel& model, const std::string& path, double range_offset_m = 0);

// Before a training it states the room of the records. Throws Error(failed) if the axes differ, or
// as empty_room_of().
void state_empty_room(Dataset& data, const std::string& path);

// The data are on the model's axes. The radar's values become those that the radar would have seen
// in the room of the training. The histogram stays, as its scatter belongs to its counts.
void exchange_room(const EmptyRoom& change, Dataset& data);

}  // namespace echofuse::recon
