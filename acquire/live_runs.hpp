// SPDX-License-Identifier: MIT
// The `status` command: the runs that are being recorded on this machine, whoever does it.
#pragma once
#include <string>

#include "drivers/core/clock.hpp"

namespace echofuse::acquire {

// By the locks of their devices (device_locks.hpp). A text, or a JSON array of objects: run, who,
// records, last_index, age_s (since the last slot's end), window_s, label, fault (why the file
// cannot be read, else empty), and sensors: {NAME: {verdict, valid, used, lost}}, used and verdict
// of the last record, lost of the whole run.
std::string describe_live_runs(const Clock& clock, bool json);

}  // namespace echofuse::acquire
