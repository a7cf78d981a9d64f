// SPDX-License-Identifier: MIT
#pragma once
#include <string>

namespace echofuse::record {

// Reads a closed run with the checks of all readers, except the values of the samples. A program
// calls this function before it publishes a run that it has written. Throws Error(failed) if the
// run cannot be read. The error names `place`, the path of the published file.
void check_written_run(const std::string& path, const std::string& place);

}  // namespace echofuse::record
