// SPDX-License-Identifier: MIT
// Whether a run fits the disk, as an estimate before it starts.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"

namespace echofuse::acquire {

// Bytes of one record with these axes, depth maps as if PNG did not shrink them: rather too many.
std::uint64_t record_bytes(const std::vector<Axis>& axes);

// Of the file system that holds this run's file; none if it does not tell.
std::optional<std::uint64_t> free_bytes(const std::string& run);

// What to warn of: a run of `count` slots that needs more than is free, or, without a count, room
// for less than a day. Empty if there is enough.
std::string room_warning(std::uint64_t bytes_per_record, std::optional<std::int64_t> count,
                         double window_s, std::uint64_t free);
// For a run of these axes in this file, of what its file system has free.
std::string room_warning(const std::string& run, const std::vector<Axis>& axes,
                         std::optional<std::int64_t> count, double window_s);

}  // namespace echofuse::acquire
