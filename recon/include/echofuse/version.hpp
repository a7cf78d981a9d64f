// SPDX-License-Identifier: MIT
/// @file
/// Versions of the interface and of the library.
#pragma once

namespace echofuse {

/// Version of these headers. It rises when a program must be changed to build with them.
inline constexpr int api_version = 0;

/// Returns the version of the linked library, as `0.3.0`.
const char* version();

}  // namespace echofuse
