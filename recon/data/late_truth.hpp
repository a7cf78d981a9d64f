// SPDX-License-Identifier: MIT
// Detects depth maps that belong to the previous or next record, e.g. if an imported array of maps
// is shifted by one record.
#pragma once
#include <string>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

// Correlates the mean range of each histogram with the mean depths of three maps: of the same, the
// previous and the next record. Returns one warning line for each run in which the maps of the
// previous or next records correlate clearly better than those of the same records. Ignores
// doubtful rows.
std::string late_truth(const Dataset& data);

}  // namespace echofuse::recon
