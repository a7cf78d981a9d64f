// SPDX-License-Identifier: MIT
#include <algorithm>

#include "recon/data/dataset.hpp"

namespace echofuse::recon {

bool Dataset::lacks_array(std::size_t row) const {
  const auto values = array.row(row);
  return array.cols > 0 &&
         std::all_of(values.begin(), values.end(), [](float v) { return v == 0; });
}

void drop_array(Dataset& data) {
  data.array_axis = {};
  data.array = Matrix(data.size(), 0);
}

}  // namespace echofuse::recon
