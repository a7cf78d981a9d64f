// SPDX-License-Identifier: MIT
// NumPy array file (.npy), format 1 to 3. Source: numpy.lib.format.
//   "\x93NUMPY", u8 major, u8 minor, u16 (1) or u32 (2, 3) length of the header, the header as a
//   Python dict: {'descr': '<f4', 'fortran_order': False, 'shape': (3, 64, 64), }, the values
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/util/regular_file.hpp"

namespace echofuse {

// Reads numbers in C order: bool, integers of 1 to 8 bytes, floats of 4 and 8 bytes, little-endian.
class NpyFile {
 public:
  // Throws Error(failed): not a .npy file, unsupported type or order, or a size that contradicts
  // the header.
  explicit NpyFile(const std::string& path);

  const std::string& path() const { return path_; }
  const std::vector<std::size_t>& shape() const { return shape_; }  // at least one dimension
  std::size_t rows() const { return shape_[0]; }
  std::size_t row_size() const { return row_size_; }  // values per row; 1 for a plain list
  bool is_integer() const { return kind_ != 'f'; }
  std::string shape_text() const;  // "[300, 64, 64]"
  // Returns the values of the next row. Throws Error(failed) past the last row.
  std::vector<double> next_row();

 private:
  void read_header();
  [[noreturn]] void refuse(const std::string& what) const;
  std::string path_;
  RegularFile file_;
  std::vector<std::size_t> shape_;
  std::size_t row_size_ = 1, item_bytes_ = 0;
  char kind_ = 'f';  // NumPy's kind: b, i, u, f
};

// Returns a header of 128 bytes. The fixed length allows the number of rows to be written last.
// `type` is NumPy's ("<f4", "<i8", "|u1").
std::string npy_header(const std::string& type, std::uint64_t rows,
                       const std::vector<std::size_t>& row_shape);

}  // namespace echofuse
