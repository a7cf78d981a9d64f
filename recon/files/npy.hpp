// SPDX-License-Identifier: MIT
// NumPy's array file, as far as the published recordings need it.
//
//   off 0   u8[6] "\x93NUMPY" | 6 u8 major | 7 u8 minor
//   off 8   u16 length of the header (version 1) or u32 (versions 2 and 3)
//   then    header, a Python dictionary: {'descr': '<f4', 'fortran_order': False,
//           'shape': (60, 91), }
//   then    the values, little-endian
// Source: numpy.lib.format.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon {

struct NpyArray {
  std::vector<std::size_t> shape;
  std::vector<float> values;  // row-major, whatever the order in the file
};

// float32 or float64 only. Throws Error(failed) that names the file and what is wrong.
NpyArray read_npy(const std::string& path);
NpyArray parse_npy(ByteView contents, const std::string& name);  // the same of a file in memory

}  // namespace echofuse::recon
