// SPDX-License-Identifier: MIT
// Detects depth maps that belong to the previous or next record, e.g. if an imported array of maps
// is shifted by one record.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Correlates the mean range of each histogram with the mean depths of three maps: those of the
// same, the previous and the next record. Returns one warning line for each run in which the
// histograms correlate clearly better with the previous or next map than with the map of the same
// record. Ignores doubtful rows.
std::string late_truth(const Dataset& data);

}  // namespace echofuse::recon
