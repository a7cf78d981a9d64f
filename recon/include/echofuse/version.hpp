// SPDX-License-Identifier: MIT
/// @file
/// Version numbers of the interface and of the library.
#pragma once
#if __cplusplus < 202002L
#error "echofuse requires C++20; compile with -std=c++20"
#endif

namespace echofuse {

/// Version of the interface in these headers, and of the SONAME of the library. It increases with
/// each incompatible change, after which programs that use the headers must be adapted.
inline constexpr int api_version = 1;

/// Returns the version of the linked library, e.g. `0.3.0`.
[[nodiscard]] const char* version();

}  // namespace echofuse
