// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <string>

#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct Components {
  std::vector<float> mean;
  Matrix basis;  // orthonormal directions, one per row, in order of decreasing variance
  std::vector<float> deviation;  // standard deviation of the table along each direction
};

// Returns the min(count, rows, columns) strongest principal components. Uses subspace iteration
// (Halko, Martinsson and Tropp, SIAM Rev. 53, 217, 2011), which is fast for few components of many
// columns.
Components principal_components(Matrix table, std::size_t count, std::uint64_t seed);

// Returns (table - mean) basis', the coordinates of the table: one row of coordinates per row of
// the table.
Matrix coordinates(const Components& components, const Matrix& table);
// Returns mean + amounts basis. This is the inverse of coordinates() within the span of the basis.
Matrix from_coordinates(const Components& components, const Matrix& amounts);

// Returns the largest standard deviation, for use as a common scale of the coordinates. If each set
// of components is divided by its scale, all sets have equal weight in a loss.
float unit_of(const Components& components);

// Reads or writes the components of a table with this number of columns.
void archive(Archive archive, Components& components, std::size_t columns);

}  // namespace echofuse::recon
