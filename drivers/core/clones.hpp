// SPDX-License-Identifier: MIT
// Compiles inner loops twice, for AVX2 and for older processors. Both versions give bit-identical
// results.
#pragma once
#include <cstddef>
#include <cstring>

// ECHOFUSE_CLONES compiles a function in two versions, with and without AVX2. FMA is not enabled,
// because fused multiply-add instructions would change the results. Sanitizer builds contain only
// one version, because the loader selects a version before the sanitizer is initialised.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ECHOFUSE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ECHOFUSE_CLONES
#endif

namespace echofuse {

// Eight floats as a SIMD vector type of GCC and clang. Pass it by reference, because the calling
// convention for passing by value depends on the processor.
inline constexpr std::size_t lanes = 8;
using Eight [[gnu::vector_size(4 * lanes)]] = float;
[[gnu::always_inline]] inline void load(Eight& to, const float* from) {
  std::memcpy(&to, from, sizeof to);
}
[[gnu::always_inline]] inline void store(float* to, const Eight& from) {
  std::memcpy(to, &from, sizeof from);
}

}  // namespace echofuse
