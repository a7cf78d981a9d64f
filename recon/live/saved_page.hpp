// SPDX-License-Identifier: MIT
// Saves the page of a run as one HTML file that contains its scripts and messages.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/live/run_messages.hpp"

namespace echofuse::view {

// Limits of a saved page. Further records are left out, and the page states how many.
inline constexpr std::size_t max_saved_records = 40, max_saved_bytes = 2'900'000;

// Returns the page. It contains the messages of the whole run, the records `listed` and, as far as
// the limits allow, doubtful records, the records with the lowest and the median IoU, and records
// at equal distances. Throws Error(failed) if the run cannot be read or has no record `listed`.
std::string saved_page(RunMessages& messages, const std::vector<std::int64_t>& listed);

}  // namespace echofuse::view
