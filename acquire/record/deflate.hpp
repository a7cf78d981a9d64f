// SPDX-License-Identifier: MIT
// The zlib format (RFC 1950), by libdeflate.
#pragma once
#include "drivers/core/bytes.hpp"

namespace echofuse::record {

// Level 1 to 12: smaller and slower. Empty if it fails.
Bytes deflated(ByteView data, int level);
// Level of a depth image in a run: a tenth smaller than with 1. Filters cost time and save nothing.
inline constexpr int depth_level = 6;
// Empty unless the data are so many bytes.
Bytes inflated(ByteView data, std::size_t size);

}  // namespace echofuse::record
