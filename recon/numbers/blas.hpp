// SPDX-License-Identifier: MIT
// Matrix product from the machine's BLAS, QR and singular values from its LAPACK. OpenBLAS's
// kernels are selected at run time (blas_kernels()), so a portable build still uses AVX2 or AVX-512
// (Eigen's own product, compiled for plain x86-64, is 5 x slower). Each call uses one thread. Large
// products are split into parts (parallel.hpp) by their shape, because OpenBLAS's own threads would
// make the order of summation depend on their number.
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
// Replaces the rows by an orthonormal basis of their span (QR); 1 <= rows <= cols.
void orthonormalise_rows(std::size_t rows, std::size_t cols, float* values);
// Computes the thin decomposition X = U S V' of an m x n table. X, U and V' are column-major; X is
// overwritten. k = min(m, n): U is m x k, V' k x n.
void decompose(std::size_t m, std::size_t n, double* x, double* s, double* u, double* vt);

// OpenBLAS 0.3.21 selects its kernels by the processor's model number and uses SSE ("Prescott") for
// unknown models. Here they are selected by the processor's features (CPUID).
//
// Returns the kernels in use ("SkylakeX" is AVX-512, "Haswell" AVX2; "BLAS" if the library is not
// OpenBLAS or was built for one processor type). They are selected at the first call, which must
// come before the first product. OPENBLAS_CORETYPE in the environment takes precedence.
const std::string& blas_kernels();
// Returns the instruction set of the kernels: AVX-512, AVX2, AVX or SSE; "unknown" for "BLAS".
std::string blas_instructions();

}  // namespace echofuse::recon
