// SPDX-License-Identifier: MIT
// Implementation of add_row_products() for one instruction set. row_product.cpp includes this file
// once per instruction set. Therefore this file must not have an include guard. Do not call
// functions of std here (see drivers/tdc/tag_groups_kernel.hpp).
#include <hwy/highway.h>

#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace echofuse::recon::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Lanes = hn::CappedTag<float, 16>;
constexpr std::size_t lanes = hn::MaxLanes(Lanes()), panel = 2 * lanes;  // columns in two vectors
// Rows of C in registers. AVX-512 and arm64 have 32 registers, the others have 16.
constexpr std::size_t tile_rows = HWY_TARGET <= HWY_AVX3 || HWY_ARCH_ARM_A64 ? 12 : 6;

// Adds A B to a tile of C, which has `rows` rows and one panel of columns. `lda`, `ldc`: distance
// of two rows. B is packed: its rows are adjacent.
template <std::size_t rows>
HWY_INLINE void add_tile(std::size_t k, const float* HWY_RESTRICT a, std::size_t lda,
                         const float* HWY_RESTRICT b, float* HWY_RESTRICT c, std::size_t ldc) {
  const Lanes d;
  hn::Vec<Lanes> left[rows], right[rows];
#pragma GCC unroll 16
  for (std::size_t r = 0; r < rows; ++r)
    left[r] = hn::LoadU(d, c + r * ldc), right[r] = hn::LoadU(d, c + r * ldc + lanes);
  for (std::size_t i = 0; i < k; ++i, b += panel) {
    const auto b_left = hn::LoadU(d, b), b_right = hn::LoadU(d, b + lanes);
#pragma GCC unroll 16
    for (std::size_t r = 0; r < rows; ++r) {
      const auto x = hn::Set(d, a[r * lda + i]);
      left[r] = hn::MulAdd(x, b_left, left[r]), right[r] = hn::MulAdd(x, b_right, right[r]);
    }
  }
#pragma GCC unroll 16
  for (std::size_t r = 0; r < rows; ++r)
    hn::StoreU(left[r], d, c + r * ldc), hn::StoreU(right[r], d, c + r * ldc + lanes);
}

template <std::size_t max_rows>
HWY_INLINE void add_tile_of(std::size_t rows, std::size_t k, const float* a, std::size_t lda,
                            const float* b, float* c, std::size_t ldc) {
  if (rows == max_rows) return add_tile<max_rows>(k, a, lda, b, c, ldc);
  if constexpr (max_rows > 1) add_tile_of<max_rows - 1>(rows, k, a, lda, b, c, ldc);
}

// Adds A B to `cols` columns of C (at most one panel), for `k` columns of A and rows of B.
void add_panel(std::size_t m, std::size_t cols, std::size_t k, const float* a, std::size_t lda,
               const float* b, std::size_t ldb, float* c, std::size_t ldc, float* packed) {
  for (std::size_t i = 0; i < k; ++i)
    for (std::size_t j = 0; j < panel; ++j) packed[i * panel + j] = j < cols ? b[i * ldb + j] : 0;
  float edge[tile_rows * panel] = {};  // columns of C that do not fill a panel
  for (std::size_t row = 0; row < m; row += tile_rows) {
    const std::size_t rows = m - row < tile_rows ? m - row : tile_rows;
    if (cols == panel) {
      add_tile_of<tile_rows>(rows, k, a + row * lda, lda, packed, c + row * ldc, ldc);
      continue;
    }
    const auto copy = [&](float* to, std::size_t ld_to, const float* from, std::size_t ld_from) {
      for (std::size_t r = 0; r < rows; ++r)
        for (std::size_t j = 0; j < cols; ++j) to[r * ld_to + j] = from[r * ld_from + j];
    };
    copy(edge, panel, c + row * ldc, ldc);
    add_tile_of<tile_rows>(rows, k, a + row * lda, lda, packed, edge, panel);
    copy(c + row * ldc, ldc, edge, panel);
  }
}

// Adds x B to y for columns [from, n) as far as they fill vectors of D, and returns the next
// column. Reads four rows of B at a time, because y is then loaded and stored less often.
template <class D>
HWY_INLINE std::size_t add_vectors(D d, std::size_t from, std::size_t n, std::size_t k,
                                   const float* HWY_RESTRICT x, const float* HWY_RESTRICT b,
                                   float* HWY_RESTRICT y) {
  constexpr std::size_t step = hn::MaxLanes(D());
  const std::size_t end = from + (n - from) / step * step;
  std::size_t i = 0;
  for (; i + 4 <= k; i += 4, b += 4 * n) {
    const auto x0 = hn::Set(d, x[i]), x1 = hn::Set(d, x[i + 1]), x2 = hn::Set(d, x[i + 2]),
               x3 = hn::Set(d, x[i + 3]);
    for (std::size_t j = from; j < end; j += step) {
      auto sum = hn::MulAdd(x0, hn::LoadU(d, b + j), hn::LoadU(d, y + j));
      sum = hn::MulAdd(x1, hn::LoadU(d, b + n + j), sum);
      sum = hn::MulAdd(x2, hn::LoadU(d, b + 2 * n + j), sum);
      hn::StoreU(hn::MulAdd(x3, hn::LoadU(d, b + 3 * n + j), sum), d, y + j);
    }
  }
  for (; i < k; ++i, b += n)
    for (std::size_t j = from; j < end; j += step)
      hn::StoreU(hn::MulAdd(hn::Set(d, x[i]), hn::LoadU(d, b + j), hn::LoadU(d, y + j)), d, y + j);
  return end;
}

// Adds x B to the row y. Does not pack B, because packing takes longer than one pass over B.
void add_row(std::size_t n, std::size_t k, const float* x, const float* b, float* y) {
  const std::size_t at = add_vectors(Lanes(), 0, n, k, x, b, y);
  add_vectors(hn::CappedTag<float, 1>(), at, n, k, x, b, y);
}

std::size_t panel_width() { return panel; }

}  // namespace echofuse::recon::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
