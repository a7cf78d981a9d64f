// SPDX-License-Identifier: MIT
#include "sim/study/information.hpp"

#include <cmath>
#include <limits>
#include <numeric>

namespace echofuse::sim {

Matrix slopes(const Model& model, const Values& at, double step) {
  Matrix out;
  for (std::size_t p = 0; p < at.size(); ++p) {
    Values moved = at;
    moved[p] = at[p] + step;
    Values above = model(moved);
    moved[p] = at[p] - step;
    const Values below = model(moved);
    for (std::size_t i = 0; i < above.size(); ++i) above[i] = (above[i] - below[i]) / (2 * step);
    out.push_back(std::move(above));
  }
  return out;
}

Matrix information(const Matrix& rows, std::size_t first, std::size_t count) {
  Matrix out(rows.size(), Values(rows.size()));
  for (std::size_t p = 0; p < rows.size(); ++p)
    for (std::size_t q = 0; q < rows.size(); ++q) {
      const double* a = rows[p].data() + first;
      out[p][q] = std::inner_product(a, a + count, rows[q].data() + first, 0.0);
    }
  return out;
}

// Cholesky gives M = L L^T; then g^T M^-1 g = |L^-1 g|^2. Parameters are in units of their own
// deviation: their scales must not decide what counts as singular.
double least_deviation(const Matrix& m, const Values& gradient) {
  const std::size_t n = m.size();
  constexpr double singular = 1e-13;
  Matrix l(n, Values(n));
  double sum = 0;
  Values solved(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double unit = std::sqrt(m[i][i]);
    if (!(unit > 0)) return std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j <= i; ++j) {
      double rest = m[i][j] / unit / std::sqrt(m[j][j]);
      for (std::size_t k = 0; k < j; ++k) rest -= l[i][k] * l[j][k];
      if (i == j && rest < singular) return std::numeric_limits<double>::infinity();
      l[i][j] = i == j ? std::sqrt(rest) : rest / l[j][j];
    }
    double rest = gradient[i] / unit;
    for (std::size_t k = 0; k < i; ++k) rest -= l[i][k] * solved[k];
    solved[i] = rest / l[i][i];
    sum += solved[i] * solved[i];
  }
  return std::sqrt(sum);
}

}  // namespace echofuse::sim
