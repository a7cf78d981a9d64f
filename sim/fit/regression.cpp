// SPDX-License-Identifier: MIT
#include "sim/fit/regression.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace echofuse::sim {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// With x = U S V^T: the hat matrix is U S^2 / (S^2 + ridge) U^T, and a residual of who is left out
// is the residual over 1 - hat.
Prediction predict(const MatrixXd& x, const VectorXd& y, const VectorXd& at) {
  const auto n = static_cast<double>(x.rows());
  const VectorXd middle = x.colwise().mean().transpose();
  MatrixXd z = x.rowwise() - middle.transpose();
  VectorXd here = at - middle;
  for (Eigen::Index j = 0; j < z.cols(); ++j) {
    const double deviation = std::sqrt(z.col(j).squaredNorm() / n);
    const double scale = deviation > 1e-12 ? 1 / deviation : 0;
    z.col(j) *= scale;
    // Farther out nothing was learned.
    here[j] = std::clamp(here[j] * scale, -4.0, 4.0);
  }
  const double mean = y.mean();
  const VectorXd centred = y.array() - mean;
  const Eigen::JacobiSVD<MatrixXd> svd(z, Eigen::ComputeThinU | Eigen::ComputeThinV);
  const VectorXd s = svd.singularValues(), uy = svd.matrixU().transpose() * centred;
  Prediction best;
  double least = std::numeric_limits<double>::infinity();
  for (double ridge = 1e-4 * n; ridge < 1e3 * n; ridge *= std::sqrt(10.0)) {
    const VectorXd shrink = s.array().square() / (s.array().square() + ridge);
    const VectorXd rest = centred - svd.matrixU() * shrink.cwiseProduct(uy);
    double press = 0;
    for (Eigen::Index i = 0; i < rest.size(); ++i) {
      const double hat = 1 / n + svd.matrixU().row(i).cwiseAbs2().dot(shrink);
      const double out = rest[i] / std::max(0.05, 1 - hat);
      press += out * out;
    }
    if (press >= least) continue;
    least = press;
    const VectorXd over = s.array() / (s.array().square() + ridge);
    best = {mean + here.dot(svd.matrixV() * over.cwiseProduct(uy)), std::sqrt(press / n)};
  }
  return best;
}

}  // namespace echofuse::sim
