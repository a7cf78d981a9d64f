// SPDX-License-Identifier: MIT
// Detects depth maps that belong to another record, e.g. if an imported array of maps is shifted.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Correlates the mean range of each histogram with the mean depth of its own map and of the maps up
// to 5 records before and after it. Returns one warning line for each run in which the histograms
// correlate clearly better with other maps than with their own, in the whole run or in a block of
// 100 records, because a camera may lose a frame in the middle of a run. Ignores doubtful rows.
std::string late_truth(const Dataset& data);

}  // namespace echofuse::recon
