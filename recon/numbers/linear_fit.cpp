// SPDX-License-Identifier: MIT
#include "recon/numbers/linear_fit.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "recon/numbers/blas.hpp"

namespace echofuse::recon {

std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double penalty) {
  const std::size_t n = inputs.rows, d = inputs.cols;
  std::vector<float> x = inputs.values;
  std::vector<float> squares(d * d), scale(d);
  std::vector<double> wanted(d);
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const auto root = static_cast<float>(std::sqrt(double{counts[i]} / all));
    for (std::size_t c = 0; c < d; ++c) {
      float& v = x[i * d + c];
      v *= root;
      scale[c] += v * v;
      wanted[c] += double{v} * double{targets[i] * root};
    }
  }
  for (float& s : scale) s = s > 0 ? 1 / std::sqrt(s) : 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t c = 0; c < d; ++c) x[i * d + c] *= scale[c];
  for (std::size_t c = 0; c < d; ++c) wanted[c] *= double{scale[c]};
  multiply({d, d, n, Transpose::yes, Transpose::no}, x.data(), x.data(), squares.data());
  const auto size = static_cast<Eigen::Index>(d);
  Eigen::MatrixXd normal = Eigen::Map<Eigen::MatrixXf>(squares.data(), size, size).cast<double>();
  normal.diagonal().array() += penalty;
  const Eigen::VectorXd solved =
      normal.ldlt().solve(Eigen::Map<Eigen::VectorXd>(wanted.data(), size));
  std::vector<double> out(d);
  for (std::size_t c = 0; c < d; ++c)
    out[c] = solved(static_cast<Eigen::Index>(c)) * double{scale[c]};
  return out;
}

double product(std::span<const float> row, std::span<const double> weights) {
  return std::inner_product(row.begin(), row.end(), weights.begin(), 0.0);
}

std::vector<float> quadratic_terms(std::span<const float> values) {
  std::vector<float> out{1};
  out.reserve((values.size() + 1) * (values.size() + 2) / 2);
  out.insert(out.end(), values.begin(), values.end());
  for (std::size_t i = 0; i < values.size(); ++i)
    for (std::size_t j = 0; j <= i; ++j) out.push_back(values[i] * values[j]);
  return out;
}

}  // namespace echofuse::recon
