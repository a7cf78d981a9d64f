// SPDX-License-Identifier: MIT
#pragma once
#include <string>

namespace echofuse::record {

// Changes the status of a crashed run from "open" to "crashed" and merges its WAL. Does nothing if
// the file is not a run or is damaged, not writable or in use by another program.
void recover(const std::string& path);

}  // namespace echofuse::record
