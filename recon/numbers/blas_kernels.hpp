// SPDX-License-Identifier: MIT
// OpenBLAS 0.3.21 picks its kernels by the processor's model number and takes SSE ("Prescott") for
// one that it does not know by name. Here they are picked by what the processor can do (CPUID).
#pragma once
#include <string>

namespace echofuse::recon {

// Returns the kernels in use ("SkylakeX" is AVX-512, "Haswell" AVX2). They are chosen at the first
// call, which must come before the first product. OPENBLAS_CORETYPE in the environment wins. The
// name is "BLAS" if the library is not OpenBLAS, or one built for a single processor.
const std::string& blas_kernels();
// Returns the kernels' instructions: AVX-512, AVX2, AVX or SSE; "unknown" for "BLAS".
std::string blas_instructions();

}  // namespace echofuse::recon
