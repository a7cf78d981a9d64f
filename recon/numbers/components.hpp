// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

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

// Distances of a row from a table: T^2 along the principal components of the table, and Q, the
// squared distance from them, of each group of columns (Jackson and Mudholkar, Technometrics 21,
// 341, 1979). The columns are scaled so that each group has the same total variance. `groups`:
// index of the first column of each group, followed by the number of columns.
class ComponentDistances {
 public:
  using Groups = std::span<const std::size_t>;
  struct Values {
    std::vector<double> log_q;  // one value per group
    double log_t2 = 0;
    std::size_t group = 0;  // group that contributes most to T^2
  };
  void fit(Matrix table, Groups groups, std::uint64_t seed);
  Values operator()(std::span<const float> row, Groups groups) const;
  void archive(Archive archive, std::size_t columns);

 private:
  std::vector<float> scale_;  // factor of each column
  Components components_;
};

}  // namespace echofuse::recon
