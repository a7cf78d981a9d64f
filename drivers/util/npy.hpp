// SPDX-License-Identifier: MIT
// NumPy array file (.npy), format versions 1 to 3. Source: numpy.lib.format.
//   "\x93NUMPY", u8 major, u8 minor, u16 (1) or u32 (2, 3) length of the header, the header as a
//   Python dict: {'descr': '<f4', 'fortran_order': False, 'shape': (3, 64, 64), }, the values
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/util/regular_file.hpp"

namespace echofuse {

// Reads a .npy file that contains little-endian numbers in C order: bool, integers of 1 to 8 bytes,
// or floats of 4 or 8 bytes.
class NpyFile {
 public:
  // Throws Error(failed) if the file is not a .npy file, if its data type or array order is not
  // supported, or if its size does not match the header.
  explicit NpyFile(const std::string& path);

  const std::string& path() const { return path_; }
  const std::vector<std::size_t>& shape() const { return shape_; }  // at least one dimension
  std::size_t rows() const { return shape_[0]; }
  std::size_t row_size() const {
    return row_size_;
  }  // values per row; 1 for a one-dimensional array
  bool is_integer() const { return kind_ != 'f'; }
  bool is_bool() const { return kind_ == 'b'; }
  // Returns the array's shape as text, for example "[300, 64, 64]".
  std::string shape_text() const;
  // Returns the values of the next row. Throws Error(failed) if there are no more rows.
  std::vector<double> next_row();

 private:
  void read_header();
  [[noreturn]] void refuse(const std::string& what) const;
  std::string path_;
  RegularFile file_;
  std::vector<std::size_t> shape_;
  std::size_t row_size_ = 1, item_bytes_ = 0;
  char kind_ = 'f';  // NumPy's letter for the data type: b, i, u or f
};

// Returns a header of 128 bytes. Its length is constant, so that it can be overwritten once the
// number of rows is known. `type` is a NumPy type: "<f4", "<i8" or "|u1".
std::string npy_header(const std::string& type, std::uint64_t rows,
                       const std::vector<std::size_t>& row_shape);

}  // namespace echofuse
