// SPDX-License-Identifier: MIT
// The parts of a simulated data set (acquire/record/data_set_part.hpp), and of a long run
// (run_parts.hpp), are one run: a training on the parts equals one on the whole.
#pragma once
#include <string>
#include <vector>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Returns the run files in the order given, but the parts of a data set are together where its
// first one was, in the order of their records. Throws Error(failed) for records that two parts
// have, and for parts of one data set with different calibrations.
std::vector<std::string> in_order_of_records(const std::vector<std::string>& paths);

// True if the run is another part of the data set that was loaded last. Throws Error(failed) for a
// run that was loaded before.
bool goes_on(const Dataset& data, const std::string& path, const record::RunInfo& info);

}  // namespace echofuse::recon
