// SPDX-License-Identifier: MIT
// Row-major table of floats: one row per record.
#pragma once
#include <algorithm>
#include <cstddef>
#include <numeric>
#include <span>
#include <vector>

namespace echofuse::recon {

struct Matrix {
  std::size_t rows = 0, cols = 0;
  std::vector<float> values;

  Matrix() = default;
  Matrix(std::size_t row_count, std::size_t col_count)
      : rows(row_count), cols(col_count), values(row_count * col_count) {}
  std::span<float> row(std::size_t i) { return {values.data() + i * cols, cols}; }
  std::span<const float> row(std::size_t i) const { return {values.data() + i * cols, cols}; }
  void add_row(std::span<const float> row_values) {
    values.insert(values.end(), row_values.begin(), row_values.end());
    ++rows;
  }
};

// Indices of records within a Dataset, in the order in which they are used.
using Rows = std::vector<std::size_t>;

inline Rows all_rows(std::size_t count) {
  Rows out(count);
  std::iota(out.begin(), out.end(), std::size_t{0});
  return out;
}

inline Matrix repeated_row(std::span<const float> row, std::size_t count) {
  Matrix out(0, row.size());
  out.values.reserve(count * row.size());
  for (std::size_t i = 0; i < count; ++i) out.add_row(row);
  return out;
}

inline Matrix take_rows(const Matrix& from, const Rows& rows) {
  Matrix out(rows.size(), from.cols);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto source = from.row(rows[i]);
    std::copy(source.begin(), source.end(), out.row(i).begin());
  }
  return out;
}

inline void append_rows(Matrix& to, const Matrix& more) {
  if (to.rows == 0) to.cols = more.cols;
  for (std::size_t i = 0; i < more.rows; ++i) to.add_row(more.row(i));
}

}  // namespace echofuse::recon
