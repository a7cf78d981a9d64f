// SPDX-License-Identifier: MIT
// Matrix product with one record per row. BLAS selects its kernel by the shape of the product, so
// that a row depends on the number of rows computed with it. Here every element is one chain of
// multiply-adds in the order of k. A row is therefore identical bit for bit in a product of any
// number of rows, for any number of threads, and on all processors with AVX2, AVX-512 or NEON.
#pragma once
#include <cstddef>

namespace echofuse::recon {

// Computes C += A B. All matrices are row-major and dense: A is m x k, B is k x n, and C is m x n.
void add_row_products(std::size_t m, std::size_t n, std::size_t k, const float* a, const float* b,
                      float* c);

}  // namespace echofuse::recon
