// SPDX-License-Identifier: MIT
// A model that was trained in one room, taken to another one, of which there are records of nobody:
// what stands still there is exchanged for what stood still in training, in histogram, profile and
// the antennas' lags, and the maps show the new walls.
#pragma once
#include <string>

#include "recon/estimator/trained_model.hpp"

namespace echofuse::recon {

// Of a run without people, on its own axes: the mean of its records. Throws Error(failed) if
// fewer than five have all sensors that these data have, or people are in it.
EmptyRoom empty_room_of(const Dataset& empty, const std::string& path);

// `path`: a run without people. Changes the model's estimators; returns what there is to say,
// or nothing. Without depth maps in the run the maps show the walls of the training. The
// range offset is taken off the run's radar as off the records' (prepare_records). Throws
// Error(failed) if the axes are not the model's, no record has its sensors, people are in it, or
// the model does not place a body.
std::string take_to_room(TrainedModel& model, const std::string& path, double range_offset_m = 0);

// Before a training: states the room that its records are of. Throws Error(failed) if the axes
// differ, or as empty_room_of().
void state_empty_room(Dataset& data, const std::string& path);

// Of data on the model's axes: what the radar sees becomes what it would have seen in the room of
// the training. The histogram stays, as its scatter belongs to its counts.
void exchange_room(const EmptyRoom& change, Dataset& data);

}  // namespace echofuse::recon
