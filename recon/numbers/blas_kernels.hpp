// SPDX-License-Identifier: MIT
// OpenBLAS 0.3.21 picks its kernels by the processor's model number and takes SSE ("Prescott") for
// one that it does not know by name. Here they are picked by what the processor can do (CPUID).
#pragma once
#include <string>

namespace echofuse::recon {

// The kernels in use ("SkylakeX" is AVX-512, "Haswell" AVX2), chosen at the first call, which must
// come before the first product. OPENBLAS_CORETYPE in the environment wins. "BLAS" if the library
// is not OpenBLAS, or one built for a single processor.
const std::string& blas_kernels();
// What they are made of: AVX-512, AVX2, AVX or SSE; "unknown" of "BLAS".
std::string blas_instructions();

}  // namespace echofuse::recon
