// SPDX-License-Identifier: MIT
// Detects depth maps assigned to the previous or next record, e.g. of arrays shifted by one.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Compares the histogram's mean range with the mean depth of the maps of the same, the previous and
// the next record. Returns a line with a remedy for each run in which a neighbouring map clearly
// fits better. Ignores doubtful rows.
std::string late_truth(const Dataset& data);

}  // namespace echofuse::recon
