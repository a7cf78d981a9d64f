// SPDX-License-Identifier: MIT
// A linear fit gives one number from a few: it is weighted least squares in closed form.
#pragma once
#include <span>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// Returns the weights w for which the rows of `inputs` times w come nearest to the targets; each
// row counts as `counts` says. `penalty` applies to the squares of w, for columns of unit mean
// square.
std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double penalty);

double product(std::span<const float> row, std::span<const double> weights);

// The terms are 1, every value, and every product of two values.
std::vector<float> quadratic_terms(std::span<const float> values);

}  // namespace echofuse::recon
