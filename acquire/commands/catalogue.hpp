// SPDX-License-Identifier: MIT
// The `list` command: the runs of a folder, and those that are being recorded.
#pragma once
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

struct Catalogue {
  std::string text;
  std::string left_out;  // files that are no run, or that cannot be read: a line each, with why
};

// All runs (*.sqlite) of the folder, oldest first: one line for each and more on the live ones, or
// one JSON array. A live one's object has `live`: who (by the locks of its devices), last_index,
// age_s (since the last slot's end), label, and sensors: {NAME: {verdict, valid, used, lost}}, used
// and verdict of the last record, lost of the whole run. With `elsewhere` also the runs that are
// recorded on this machine into other folders. Throws Error(failed) if the folder cannot be read.
Catalogue list_runs(const std::string& folder, bool elsewhere, const Clock& clock, bool json);

}  // namespace echofuse::acquire
