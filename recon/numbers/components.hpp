// SPDX-License-Identifier: MIT
// Principal components of the rows of a table.
#pragma once
#include <cstdint>
#include <string>

#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct Components {
  std::vector<float> mean;       // mean of each column
  Matrix basis;                  // one orthonormal direction a row, the strongest first
  std::vector<float> deviation;  // standard deviation of the table along each
};

// Returns min(count, rows, columns) components. The method is subspace iteration (Halko, Martinsson
// and Tropp, SIAM Rev. 53, 217, 2011), for few directions of many columns.
Components principal_components(Matrix table, std::size_t count, std::uint64_t seed);

// Computes (table - mean) basis': one row of coordinates a row.
Matrix coordinates(const Components& components, const Matrix& table);
// Inverse of coordinates() within the span of the basis: mean + amounts basis.
Matrix from_coordinates(const Components& components, const Matrix& amounts);

// Common unit of the amounts along the components, so that several kinds weigh alike in a loss.
float unit_of(const Components& components);

// Reads or writes the components of a table with this number of columns.
void archive(Archive archive, Components& components, std::size_t columns);

}  // namespace echofuse::recon
