// SPDX-License-Identifier: MIT
#include "recon/numbers/matrix_file.hpp"

namespace echofuse::recon {

void write_matrix(record::H5File& file, const std::string& name, const Matrix& table) {
  file.write<float>(name, table.values, {table.rows, table.cols});
}

Matrix read_matrix(const record::H5File& file, const std::string& name, std::size_t rows,
                   std::size_t cols) {
  Matrix out;
  const auto values = file.read<float>(name, {rows, cols});
  out.values.assign(values.begin(), values.end());
  const auto shape = file.shape(name);
  out.rows = shape[0], out.cols = shape[1];
  return out;
}

void require_sound(const record::H5File& file, bool sound, const std::string& object,
                   const std::string& expected) {
  if (!sound) file.refuse(object, "expected " + expected);
}

}  // namespace echofuse::recon
