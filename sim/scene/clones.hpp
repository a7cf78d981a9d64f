// SPDX-License-Identifier: MIT
// For inner loops: one version for processors with AVX2, one for others, with the same bits.
#pragma once

// Not FMA: contracted products would make other bits. Sanitizers are not up yet when the loader
// chooses a clone.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define ECHOFUSE_CLONES __attribute__((target_clones("avx2", "default")))
#else
#define ECHOFUSE_CLONES
#endif
