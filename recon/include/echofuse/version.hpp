// SPDX-License-Identifier: MIT
/// @file
/// Version numbers of the interface and of the library.
#pragma once

namespace echofuse {

/// Version of the interface in these headers. It increases with each incompatible change, after
/// which programs that use the headers must be adapted.
inline constexpr int api_version = 0;

/// Returns the version of the linked library, e.g. `0.3.0`.
const char* version();

}  // namespace echofuse
