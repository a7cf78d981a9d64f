// SPDX-License-Identifier: MIT
// Files of one uuid, in the order of their first record, are one run: the parts of a long run, and
// those of a simulated data set. A training on the parts equals one on the whole.
#pragma once
#include <string>
#include <vector>

namespace echofuse::recon {

// Returns the run files in the order given, but those of one uuid together where the first of them
// was, in the order of their records. Throws Error(failed) for records that two of them have, and
// for different calibrations.
std::vector<std::string> in_order_of_records(const std::vector<std::string>& paths);

}  // namespace echofuse::recon
