// SPDX-License-Identifier: MIT
#include "recon/numbers/row_product.hpp"

#include <algorithm>
#include <vector>

#include "recon/numbers/parallel.hpp"

// Arrays cannot contain vectors of variable length.
#define HWY_DISABLED_TARGETS (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#define HWY_TARGET_INCLUDE "recon/numbers/row_product_kernel.hpp"
#include <hwy/foreach_target.h>

#include "recon/numbers/row_product_kernel.hpp"

namespace echofuse::recon {
namespace {

HWY_EXPORT(add_panel);
HWY_EXPORT(add_row);
HWY_EXPORT(panel_width);

constexpr std::size_t few_rows = 3;     // up to here, single rows are faster than packing B
constexpr std::size_t depth = 256;      // rows of a packed panel, so that it stays in the L1 cache
constexpr std::size_t small = 1 << 22;  // multiply-adds of a part that is worth a thread

}  // namespace

void add_row_products(std::size_t m, std::size_t n, std::size_t k, const float* a, const float* b,
                      float* c) {
  if (m <= few_rows) {
    for (std::size_t i = 0; i < m; ++i)
      HWY_DYNAMIC_DISPATCH(add_row)(n, k, a + i * k, b, c + i * n);
    return;
  }
  if (n == 0) return;
  const std::size_t width = HWY_DYNAMIC_DISPATCH(panel_width)(), panels = (n + width - 1) / width;
  const bool by_rows = m > n;  // splits the longer side of C
  const std::size_t pieces = by_rows ? (m + width - 1) / width : panels;
  const std::size_t parts = std::clamp<std::size_t>(m * n * k / small, 1, pieces);
  const std::size_t size = std::min(k, depth) * width;
  std::vector<float> packed(parts * size);
  for_each_part(parts, [&](std::size_t part) {
    const std::size_t from = part * pieces / parts, to = (part + 1) * pieces / parts;
    const std::size_t row = by_rows ? from * width : 0;
    const std::size_t rows = by_rows ? std::min(m, to * width) - row : m;
    for (std::size_t i = 0; i < k; i += depth)
      for (std::size_t p = by_rows ? 0 : from; p < (by_rows ? panels : to); ++p) {
        const std::size_t col = p * width;
        HWY_DYNAMIC_DISPATCH(add_panel)
        (rows, std::min(width, n - col), std::min(depth, k - i), a + row * k + i, k,
         b + i * n + col, n, c + row * n + col, n, packed.data() + part * size);
      }
  });
}

}  // namespace echofuse::recon
