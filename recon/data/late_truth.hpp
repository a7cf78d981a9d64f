// SPDX-License-Identifier: MIT
// Detects depth maps that belong to another record, e.g. if an imported array of maps is shifted.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Compares the mean range of each histogram with the mean depth of its own map and of the maps up
// to 5 records before and after it. Returns one warning line for each block of at least 20 records
// of a run in which the histograms fit other maps clearly better than their own, because a camera
// may lose a frame in the middle of a run. Ignores doubtful rows.
std::string late_truth(const Dataset& data);

}  // namespace echofuse::recon
