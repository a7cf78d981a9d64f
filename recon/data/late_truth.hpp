// SPDX-License-Identifier: MIT
// Depth maps that belong to the record before or after theirs, as of arrays shifted by one.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Compares the mean range of the histogram with the mean depth of the map of the record itself, of
// the record before and of the one after. Returns a line with a remedy for each run of which one of
// these two fits clearly better. Doubtful rows are ignored.
std::string late_truth(const Dataset& data);

}  // namespace echofuse::recon
