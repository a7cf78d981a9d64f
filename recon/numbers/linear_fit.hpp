// SPDX-License-Identifier: MIT
// One number from a few: weighted least squares in closed form.
#pragma once
#include <span>
#include <vector>

#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// The weights w that make the rows of `inputs` times w the targets, each row counting as much as
// `counts` says. `penalty` on the squares of w, for columns of unit mean square.
std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double penalty);

double product(std::span<const float> row, std::span<const double> weights);

// 1, every value, and every product of two of them.
std::vector<float> quadratic_terms(std::span<const float> values);

}  // namespace echofuse::recon
