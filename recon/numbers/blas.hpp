// SPDX-License-Identifier: MIT
// Matrix product by the machine's BLAS; QR decomposition and singular values by its LAPACK. The
// kernels of OpenBLAS are selected at run time (blas_kernels()), so that a portable build also uses
// AVX2 or AVX-512. Eigen's own product, compiled for plain x86-64, is 5 times slower. Each call of
// BLAS uses one thread. Large products are split into parts according to their shape
// (parallel.hpp). OpenBLAS's own threads are not used, because the order of summation would depend
// on their number.
#pragma once
#include <cstddef>
#include <string>

namespace echofuse::recon {

enum class Transpose : bool { no, yes };

// Describes the product C = alpha op(A) op(B) + beta C, where op() is the matrix or its transpose.
// All matrices are row-major and dense: op(A) is m x k, op(B) is k x n, and C is m x n.
template <class T>
struct Product {
  std::size_t m, n, k;
  Transpose a_transposed = Transpose::no, b_transposed = Transpose::no;
  T alpha = 1, beta = 0;
};
void multiply(const Product<float>& p, const float* a, const float* b, float* c);
void multiply(const Product<double>& p, const double* a, const double* b, double* c);
// Replaces the rows of a table with an orthonormal basis of their span (QR decomposition). Requires
// 1 <= rows <= cols.
void orthonormalise_rows(std::size_t rows, std::size_t cols, float* values);
// Computes the thin singular value decomposition X = U S V' of an m x n table. With k = min(m, n),
// U is m x k, S has k values, and V' is k x n. X, U and V' are column-major; X is overwritten.
// Throws Error(failed) if X contains NaN or infinity.
void decompose(std::size_t m, std::size_t n, double* x, double* s, double* u, double* vt);

// Returns the name of the OpenBLAS kernels in use, e.g. "SkylakeX" (AVX-512) or "Haswell" (AVX2).
// Returns "BLAS" if the library is not OpenBLAS or was built for one processor type. The first call
// selects the kernels and must precede the first product.
// OpenBLAS 0.3.21 selects kernels by the model number of the processor, and uses SSE ("Prescott")
// for unknown models. This function selects them by the processor's features (CPUID) instead. The
// environment variable OPENBLAS_CORETYPE takes precedence.
const std::string& blas_kernels();
// Returns the instruction set of the kernels: AVX-512, AVX2, AVX or SSE; or "unknown" if
// blas_kernels() returns "BLAS".
std::string blas_instructions();

}  // namespace echofuse::recon
