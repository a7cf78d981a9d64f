// SPDX-License-Identifier: MIT
// A run in a terminal of 80 columns: histogram and profile in block characters, and the lamps.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "drivers/core/clock.hpp"
#include "drivers/program/exit_code.hpp"
#include "recon/view/followed_run.hpp"

namespace echofuse::view {

// Eight heights a character: `rows` lines of `columns` characters, the largest value at the top;
// each column shows the largest of its values. Lowest values of 0 (or below `floor`) are blank.
std::string block_chart(std::span<const float> values, std::size_t columns, std::size_t rows,
                        float floor, float ceiling);

// Returns what there is to see now, in lines of at most 80 characters; `colours` are those of a
// terminal.
std::string text_page(const FollowedRun& run, std::optional<std::int64_t> planned, UtcTime now,
                      bool colours);

// Prints it once, or again each second on a terminal while the run is live, until interrupted().
// Throws Error(failed) if there is no run.
ExitCode text_view(FollowedRun& run, std::optional<std::int64_t> planned, const Clock& clock);

}  // namespace echofuse::view
