// SPDX-License-Identifier: MIT
// Principal components of the rows of a table.
#pragma once
#include <cstdint>
#include <string>

#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct Components {
  std::vector<float> mean;       // of the columns
  Matrix basis;                  // one orthonormal direction a row, the strongest first
  std::vector<float> deviation;  // standard deviation of the table along each
};

// At most `count`, at most as many as the table has rows or columns. By subspace iteration (Halko,
// Martinsson and Tropp, SIAM Rev. 53, 217, 2011): few directions of many columns.
Components principal_components(Matrix table, std::size_t count, std::uint64_t seed);

// (table - mean) basis': one row of coordinates a row.
Matrix coordinates(const Components& components, const Matrix& table);
// Its inverse, as far as the basis reaches: mean + amounts basis.
Matrix from_coordinates(const Components& components, const Matrix& amounts);

// Of the amounts along them, so that neither kind drowns another.
float unit_of(const Components& components);

// Of a table with so many columns.
void archive(Archive archive, Components& components, std::size_t columns);

}  // namespace echofuse::recon
