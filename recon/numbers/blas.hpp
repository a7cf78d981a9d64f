// SPDX-License-Identifier: MIT
// The matrix product comes from the machine's BLAS, QR and singular values from its LAPACK.
// OpenBLAS's kernels are chosen at run time (blas_kernels()), so a portable build still uses AVX2
// or AVX-512 (compiled for plain x86-64, Eigen's own product is 5 x slower). Each call of it uses
// one thread. Large products are cut into parts (parallel.hpp) by their shape, as OpenBLAS's own
// threads add up in another order than one does.
#pragma once
#include <cstddef>
#include <string>

namespace echofuse::recon {

enum class Transpose : bool { no, yes };

// Computes C = alpha op(A) op(B) + beta C, all row-major and dense: op(A) is m x k, op(B) k x n, C
// m x n.
template <class T>
struct Product {
  std::size_t m, n, k;
  Transpose a_transposed = Transpose::no, b_transposed = Transpose::no;
  T alpha = 1, beta = 0;
};
void multiply(const Product<float>& p, const float* a, const float* b, float* c);
void multiply(const Product<double>& p, const double* a, const double* b, double* c);
// Replaces the rows by an orthonormal basis of the space that they span (QR); 1 <= rows <= cols.
void orthonormalise_rows(std::size_t rows, std::size_t cols, float* values);
// Computes the thin decomposition X = U S V' of an m x n table that is stored by columns, as are U
// and V'. X is overwritten. k = min(m, n): U is m x k, V' k x n.
void decompose(std::size_t m, std::size_t n, double* x, double* s, double* u, double* vt);

// OpenBLAS 0.3.21 picks its kernels by the processor's model number and takes SSE ("Prescott") for
// one that it does not know by name. Here they are picked by what the processor can do (CPUID).
//
// Returns the kernels in use ("SkylakeX" is AVX-512, "Haswell" AVX2). They are chosen at the first
// call, which must come before the first product. OPENBLAS_CORETYPE in the environment wins. The
// name is "BLAS" if the library is not OpenBLAS, or one built for a single processor.
const std::string& blas_kernels();
// Returns the kernels' instructions: AVX-512, AVX2, AVX or SSE; "unknown" for "BLAS".
std::string blas_instructions();

}  // namespace echofuse::recon
