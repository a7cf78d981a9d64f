// SPDX-License-Identifier: MIT
// Input: a .npy file.
#include "recon/files/npy.hpp"

#include <cmath>
#include <limits>

#include "drivers/core/exit_code.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using fuzz::require;

namespace {

Bytes written(const NpyArray& array) {
  std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (";
  for (const std::size_t n : array.shape) header += std::to_string(n) + ",";
  header += "), }\n";
  Bytes out;
  for (const char c : std::string("\x93NUMPY\x02\x00", 8)) put(out, c);
  put(out, static_cast<std::uint32_t>(header.size()));
  out.insert(out.end(), header.begin(), header.end());
  const ByteView values = as_bytes(array.values);
  out.insert(out.end(), values.begin(), values.end());
  return out;
}

}  // namespace

void fuzz::run(ByteView input) {
  try {
    const NpyArray array = parse_npy(input, "x.npy");
    std::size_t values = 1;
    for (const std::size_t n : array.shape) values *= n;
    require(array.shape.size() <= 32 && values == array.values.size(), "the shape is the array's");
    require(values * sizeof(float) <= input.size(), "no value comes from nowhere");
    for (const float v : array.values) require(std::isfinite(v), "values are numbers");
    const NpyArray again = parse_npy(written(array), "again");
    require(again.shape == array.shape && again.values == array.values, "it can be written again");
  } catch (const Error& error) {
    const std::string_view what = error.what();
    require(error.code() == ExitCode::failed, "a fault is the file's");
    require(what.starts_with("x.npy: ") && what.size() < 200 && is_printable(what),
            "and told in a line");
  }
}
