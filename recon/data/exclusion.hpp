// SPDX-License-Identifier: MIT
// Rules by which records are excluded from training and scoring.
#pragma once
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

struct Dataset;
enum class Inputs : std::uint8_t;

// Reason to exclude a record: all bins of the SPD or radar have the same value.
inline constexpr const char* dead_record = "the same in every bin";
// Reason to exclude a record: it was used for training or validation of the model.
inline constexpr const char* trained_on_record = "trained on";
// Reason to exclude a record: an earlier record of the run has the same counts.
inline constexpr const char* duplicate_in_run = "twice in the run";

// Verdicts that exclude a record: doubtful ones, and "lossy". A model stores the exclusions of its
// training, and match() applies them to the records that it processes.
struct Exclusions {
  bool doubtful = true, lossy = false;
};

// Returns whether the record has the sensors that a model with these inputs needs.
bool has_inputs(const Dataset& data, std::size_t row, Inputs inputs);
// Returns why a model with these inputs cannot use the record; empty if it can. A sensor is dead
// if all its bins have the same value.
std::string fault_of(const Dataset& data, std::size_t row, Inputs inputs);
// Returns the verdict that makes a model with these inputs exclude a complete record, e.g.
// "camera stands still" or "SPD weak"; empty if the record is not excluded. Verdicts on the
// camera are ignored if `with_camera` is false.
std::string doubt_of(const Dataset& data, std::size_t row, Inputs inputs, bool with_camera = true);
// Returns true if the depth camera, or a sensor used by these inputs, lost samples in this record.
bool is_lossy(const Dataset& data, std::size_t row, Inputs inputs);
// Returns true if the row has a depth map and no camera verdict excludes it as a ground truth.
bool sound_depth(const Dataset& data, std::size_t row);
// For each row, returns why a model with these inputs excludes it, or an empty string if the row
// is used. Reasons: a sensor is missing, dead or doubtful, or the row is a copy of an earlier
// record.
std::vector<std::string> left_out(const Dataset& data, Inputs inputs);
// Returns the rows that left_out() does not exclude.
Rows usable(const Dataset& data, Inputs inputs);

// Returns a summary such as "3 of 60 records left out: camera stands still 2, damaged 1"; empty if
// no record is left out.
std::string left_out_text(const std::map<std::string, std::size_t>& reasons, std::size_t all);

}  // namespace echofuse::recon
