// SPDX-License-Identifier: MIT
// Fisher information of noisy measurements, and the Cramer-Rao bound that follows from it.
#pragma once
#include <cstddef>
#include <functional>
#include <vector>

namespace echofuse::sim {

using Values = std::vector<double>;
using Matrix = std::vector<Values>;  // rows

// Noise-free measurements as a function of the parameters.
using Model = std::function<Values(const Values& parameters)>;

// Returns d model / d parameter at `at`, a row a parameter, by central differences over +-step.
Matrix slopes(const Model& model, const Values& at, double step);

// Returns J J^T from `rows` of slopes, in columns first..first+count-1, with noise of unit
// variance.
//   For Gaussian noise of sigma, divide the information by sigma^2.
//   For Poisson counts of mean l it is sum (dl)^2 / l = sum (d 2 sqrt(l))^2, so let the model
//   return 2 sqrt(l). That needs no division by bins that hold next to nothing.
Matrix information(const Matrix& rows, std::size_t first, std::size_t count);

// Least standard deviation of an unbiased estimate of a quantity with this gradient: sqrt(g^T M^-1
// g), infinite if the information does not determine it. With the information of a prior added to
// the diagonal it is the posterior's width where both are Gaussian (van Trees).
double least_deviation(const Matrix& information, const Values& gradient);

}  // namespace echofuse::sim
