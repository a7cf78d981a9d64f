// SPDX-License-Identifier: MIT
#include "recon/numbers/components.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/row_product.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t spare_directions = 10;
constexpr int iterations = 6;
constexpr std::size_t rows_a_component = 60;  // rows per component of ComponentDistances
// Number of rows centred at a time, to limit the memory use.
constexpr std::size_t max_centred = 1024;

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Map<RowMajor> as_eigen(Matrix& m) {
  return {m.values.data(), static_cast<Eigen::Index>(m.rows), static_cast<Eigen::Index>(m.cols)};
}

Matrix times(const Matrix& a, const Matrix& b, Transpose a_t, Transpose b_t) {
  const std::size_t m = a_t == Transpose::yes ? a.cols : a.rows;
  const std::size_t k = a_t == Transpose::yes ? a.rows : a.cols;
  Matrix out(m, b_t == Transpose::yes ? b.rows : b.cols);
  multiply({m, out.cols, k, a_t, b_t}, a.values.data(), b.values.data(), out.values.data());
  return out;
}

void subtract(Matrix& table, const std::vector<float>& mean) {
  for (std::size_t i = 0; i < table.rows; ++i)
    for (std::size_t c = 0; c < table.cols; ++c) table.row(i)[c] -= mean[c];
}

}  // namespace

Components principal_components(Matrix table, std::size_t count, std::uint64_t seed) {
  Components out;
  const auto mean = column_statistics(table, all_rows(table.rows)).mean;
  out.mean.assign(mean.begin(), mean.end());
  subtract(table, out.mean);
  const std::size_t max_count = std::min(table.rows, table.cols);
  count = std::min(count, max_count);
  Matrix q(std::min(count + spare_directions, max_count), table.cols);
  Rng rng = make_rng(seed, 0);
  std::normal_distribution<float> normal;
  for (float& v : q.values) v = normal(rng);
  out.basis = Matrix(0, table.cols);
  if (count == 0) return out;
  orthonormalise_rows(q.rows, q.cols, q.values.data());
  for (int i = 0; i < iterations; ++i) {
    q = times(times(table, q, Transpose::no, Transpose::yes), table, Transpose::yes, Transpose::no);
    orthonormalise_rows(q.rows, q.cols, q.values.data());
  }
  Matrix seen = times(table, q, Transpose::no, Transpose::yes);
  const Eigen::MatrixXd in = as_eigen(seen).cast<double>();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(in.transpose() * in /
                                                             static_cast<double>(table.rows));
  // Eigenvalues are in ascending order, so the strongest component is the last eigenvector.
  Matrix turn(count, q.rows);
  for (std::size_t k = 0; k < count; ++k) {
    const auto last = eigen.eigenvalues().size() - 1 - static_cast<Eigen::Index>(k);
    out.deviation.push_back(
        static_cast<float>(std::sqrt(std::max(eigen.eigenvalues()(last), 0.0))));
    for (std::size_t j = 0; j < q.rows; ++j)
      turn.row(k)[j] = static_cast<float>(eigen.eigenvectors()(static_cast<Eigen::Index>(j), last));
  }
  out.basis = times(turn, q, Transpose::no, Transpose::no);
  return out;
}

Matrix coordinates(const Components& components, const Matrix& table) {
  Matrix out(table.rows, components.basis.rows);
  const std::size_t parts = (table.rows + max_centred - 1) / max_centred;
  for (std::size_t part = 0; part < parts; ++part) {
    const std::size_t first = part * table.rows / parts, end = (part + 1) * table.rows / parts;
    Matrix centred(end - first, table.cols);
    std::copy(table.row(first).begin(), table.row(end - 1).end(), centred.values.begin());
    subtract(centred, components.mean);
    multiply({centred.rows, out.cols, table.cols, Transpose::no, Transpose::yes},
             centred.values.data(), components.basis.values.data(), out.row(first).data());
  }
  return out;
}

Matrix from_coordinates(const Components& components, const Matrix& amounts) {
  Matrix out = repeated_row(components.mean, amounts.rows);
  if (amounts.cols > 0)
    add_row_products(out.rows, out.cols, amounts.cols, amounts.values.data(),
                     components.basis.values.data(), out.values.data());
  return out;
}

float unit_of(const Components& components) {
  return std::max(components.deviation.front(), 1e-6f);
}

void archive(Archive archive, Components& c, std::size_t columns) {
  archive.values("mean", c.mean, columns);
  archive.table("basis", c.basis, Archive::any, columns);
  archive.values("deviation", c.deviation, c.basis.rows);
  archive.require(
      std::all_of(c.deviation.begin(), c.deviation.end(), [](float d) { return d >= 0; }),
      "deviation", "expected no negative value");
}

void ComponentDistances::fit(Matrix table, Groups groups, std::uint64_t seed) {
  const std::size_t components = std::clamp<std::size_t>(table.rows / rows_a_component, 2, 36);
  const auto variance = column_statistics(table, all_rows(table.rows)).variance;
  scale_.clear();
  for (std::size_t g = 0; g + 1 < groups.size(); ++g) {
    double sum = 0;
    for (std::size_t c = groups[g]; c < groups[g + 1]; ++c) sum += variance[c];
    scale_.resize(groups[g + 1], sum > 0 ? static_cast<float>(1 / std::sqrt(sum)) : 0.f);
  }
  for (std::size_t i = 0; i < table.values.size(); ++i) table.values[i] *= scale_[i % table.cols];
  components_ = principal_components(std::move(table), components, seed);
  for (float& d : components_.deviation) d = std::max(d, 1e-6f);
}

ComponentDistances::Values ComponentDistances::operator()(std::span<const float> row,
                                                          Groups groups) const {
  constexpr double tiny = 1e-12;
  using Eigen::Map, Eigen::VectorXf, Eigen::Index;
  const auto vector = [](std::span<const float> v) {
    return Map<const VectorXf>(v.data(), std::ssize(v));
  };
  const Map<const RowMajor> basis(components_.basis.values.data(), Index(components_.basis.rows),
                                  Index(components_.basis.cols));
  const VectorXf from_mean = vector(row).cwiseProduct(vector(scale_)) - vector(components_.mean);
  const VectorXf amounts = basis * from_mean;
  const VectorXf off = from_mean - basis.transpose() * amounts;
  // T^2 = sum over the components of (amount / deviation)^2, as a sum over the columns.
  const auto variance = vector(components_.deviation).array().square();
  const VectorXf weights = basis.transpose() * (amounts.array() / variance).matrix();
  Values out;
  double sum = 0, largest = -INFINITY;
  for (std::size_t g = 0; g + 1 < groups.size(); ++g) {
    const auto first = Index(groups[g]), count = Index(groups[g + 1]) - first;
    const auto along = double{weights.segment(first, count).dot(from_mean.segment(first, count))};
    sum += along;
    if (along > largest) largest = along, out.group = g;
    out.log_q.push_back(std::log(double{off.segment(first, count).squaredNorm()} + tiny));
  }
  out.log_t2 = std::log(std::max(sum, 0.0) + tiny);
  return out;
}

void ComponentDistances::archive(Archive archive, std::size_t columns) {
  archive.values("scale", scale_, columns);
  recon::archive(archive.in("components"), components_, columns);
  archive.require(std::ranges::all_of(components_.deviation, [](float d) { return d > 0; }),
                  "components/deviation", "expected positive values");
}

}  // namespace echofuse::recon
