// SPDX-License-Identifier: MIT
// Ridge regression from the scaled inputs to the map. Uses the singular value decomposition of the
// inputs, which is stable if neighbouring bins are almost equal. The penalty is chosen by
// generalised cross-validation (Golub, Heath and Wahba, Technometrics 21, 215, 1979).
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "recon/models/model.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/row_product.hpp"

namespace echofuse::recon {
namespace {

using InFloat = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// Returns the penalty with the lowest generalised cross-validation score. Tries multiples of the
// squared largest singular value. `projected`: |U'Y|^2 for each singular vector. `total`: |Y|^2.
double best_penalty(const Eigen::VectorXd& s, const Eigen::VectorXd& projected, double total,
                    double records) {
  double best = 0, lowest = std::numeric_limits<double>::max();
  const double outside = std::max(total - projected.sum(), 0.0);
  for (int quarter_decades = -40; quarter_decades <= 4; ++quarter_decades) {
    const double penalty = std::pow(10, 0.25 * quarter_decades) * s(0) * s(0);
    const Eigen::ArrayXd kept = s.array().square() / (s.array().square() + penalty);
    // Computed as a sum of squares, because a difference of large numbers would amplify rounding
    // errors if the residual is small.
    const double residual = outside + (projected.array() * (1 - kept).square()).sum();
    const double freedom = records - 1 - kept.sum();  // subtracts 1 for the fitted mean
    if (freedom < 1e-3 * records) continue;
    const double gcv = residual / (freedom * freedom);
    if (gcv < lowest) lowest = gcv, best = penalty;
  }
  return best;
}

class Ridge final : public Model {
 public:
  TrainingLog fit(const Samples& train, const Samples&, const FitOptions&) override;
  Matrix predict(const Matrix& inputs, SoftMaps*) const override;
  Cost cost() const override {
    return {weights_.values.size(), weights_.values.size() + offset_.size()};
  }
  void archive(Archive archive, const Shape& shape) override {
    archive.table("weights", weights_, shape.inputs, shape.outputs);
    archive.values("offset_m", offset_, shape.outputs);
    archive.number("penalty", penalty_, 0, 1e300);
  }

 private:
  Matrix weights_;             // inputs x pixels, m per input unit
  std::vector<float> offset_;  // constant term of each pixel, m
  double penalty_ = 0;
};

TrainingLog Ridge::fit(const Samples& train, const Samples&, const FitOptions&) {
  const std::size_t n = train.rows.size(), d = train.inputs.cols, pixels = train.maps.cols;
  const Matrix inputs = take_rows(train.inputs, train.rows);
  const auto en = static_cast<Eigen::Index>(n), ed = static_cast<Eigen::Index>(d);
  const auto ep = static_cast<Eigen::Index>(pixels);
  Eigen::MatrixXd x = Eigen::Map<const InFloat>(inputs.values.data(), en, ed).cast<double>();
  const Eigen::RowVectorXd input_mean = x.colwise().mean();
  x.rowwise() -= input_mean;
  // Uses double precision, because directions with small singular values amplify rounding errors.
  RowMajor y(en, ep);
  for (std::size_t i = 0; i < n; ++i)
    y.row(static_cast<Eigen::Index>(i)) =
        Eigen::Map<const Eigen::RowVectorXf>(train.maps.row(train.rows[i]).data(), ep)
            .cast<double>();
  const Eigen::RowVectorXd mean = y.colwise().mean();
  y.rowwise() -= mean;

  const Eigen::Index er = std::min(en, ed);
  const auto rank = static_cast<std::size_t>(er);
  Eigen::VectorXd s(er);
  Eigen::MatrixXd by_columns(en, er), vt(er, ed);
  decompose(n, d, x.data(), s.data(), by_columns.data(), vt.data());
  const RowMajor u = by_columns;
  RowMajor uty(er, ep);
  multiply(Product<double>{rank, pixels, n, Transpose::yes}, u.data(), y.data(), uty.data());
  const Eigen::VectorXd projected = uty.rowwise().squaredNorm();
  penalty_ = best_penalty(s, projected, y.squaredNorm(), static_cast<double>(n));

  // W = V diag(s / (s^2 + penalty)) U'Y. Directions with a singular value of almost 0 get weight 0.
  const double tiny = 1e-12 * std::max(s(0), 1e-300);
  const Eigen::VectorXd shrink =
      (s.array() > tiny).select(s.array() / (s.array().square() + penalty_).max(1e-300), 0);
  const RowMajor v = vt.transpose() * shrink.asDiagonal();
  RowMajor w(ed, ep);
  multiply(Product<double>{d, pixels, rank}, v.data(), uty.data(), w.data());
  const Eigen::RowVectorXd offset = mean - input_mean * w;
  weights_ = Matrix(d, pixels);
  std::copy_n(w.data(), w.size(), weights_.values.begin());
  offset_.assign(offset.begin(), offset.end());
  return {};
}

Matrix Ridge::predict(const Matrix& inputs, SoftMaps*) const {
  Matrix out(inputs.rows, offset_.size());
  for (std::size_t i = 0; i < out.rows; ++i)
    std::copy(offset_.begin(), offset_.end(), out.row(i).begin());
  add_row_products(inputs.rows, out.cols, inputs.cols, inputs.values.data(), weights_.values.data(),
                   out.values.data());
  return out;
}

}  // namespace

std::unique_ptr<Model> make_ridge() { return std::make_unique<Ridge>(); }

}  // namespace echofuse::recon
