// SPDX-License-Identifier: MIT
// What a run says of itself beside its records.
#pragma once
#include <optional>

#include "acquire/record/run_file.hpp"

namespace echofuse::recon {

// How long before the run's start its radar was calibrated; none if either is not known.
std::optional<double> calibrated_days(const record::RunReader& run);

// Of how many laboratories a simulated run's records are, in turn; 0 if it says nothing.
std::size_t laboratories_of(const record::RunReader& run);

}  // namespace echofuse::recon
