// SPDX-License-Identifier: MIT
// Compiles inner loops for AVX2 and for older processors; both give identical bits.
#pragma once
#include <cstddef>
#include <cstring>

// Without FMA, because contracted products change the bits. Off with sanitizers, which are not
// initialised when the loader selects a clone.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ECHOFUSE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ECHOFUSE_CLONES
#endif

namespace echofuse {

// Eight floats for SIMD, as a vector type of GCC and clang. Pass by reference: the calling
// convention by value depends on the processor.
inline constexpr std::size_t lanes = 8;
using Eight [[gnu::vector_size(4 * lanes)]] = float;
[[gnu::always_inline]] inline void load(Eight& to, const float* from) {
  std::memcpy(&to, from, sizeof to);
}
[[gnu::always_inline]] inline void store(float* to, const Eight& from) {
  std::memcpy(to, &from, sizeof from);
}

}  // namespace echofuse
