// SPDX-License-Identifier: MIT
// For inner loops: one version for processors with AVX2, one for others, with the same bits.
#pragma once
#include <cstddef>
#include <cstring>

// Not FMA: contracted products would make other bits. Sanitizers are not up yet when the loader
// chooses a clone.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ECHOFUSE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ECHOFUSE_CLONES
#endif

namespace echofuse {

// Eight numbers that are worked on at once, as GCC and clang have it. By reference: how they are
// passed by value depends on the processor.
inline constexpr std::size_t lanes = 8;
using Eight [[gnu::vector_size(4 * lanes)]] = float;
[[gnu::always_inline]] inline void load(Eight& to, const float* from) {
  std::memcpy(&to, from, sizeof to);
}
[[gnu::always_inline]] inline void store(float* to, const Eight& from) {
  std::memcpy(to, &from, sizeof from);
}

}  // namespace echofuse
