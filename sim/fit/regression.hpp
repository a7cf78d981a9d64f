// SPDX-License-Identifier: MIT
// From a run's statistics to one quantity, learned on simulated laboratories.
#pragma once
#include <Eigen/Dense>

namespace echofuse::sim {

struct Prediction {
  double value = 0, standard_error = 0;
};

// Ridge regression of y on the columns of x (rows: laboratories), each in units of its own standard
// deviation; then the value at `at`. The ridge is the one with the least error on laboratories left
// out one at a time (PRESS), and that error is the standard error.
Prediction predict(const Eigen::MatrixXd& x, const Eigen::VectorXd& y, const Eigen::VectorXd& at);

}  // namespace echofuse::sim
