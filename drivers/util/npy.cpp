// SPDX-License-Identifier: MIT
#include "drivers/util/npy.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "drivers/core/bytes.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse {
namespace {

// Returns the value of a key in the header, up to the comma or bracket that ends it. Returns an
// empty string if the key is missing.
std::string value_of(const std::string& header, const std::string& key) {
  const auto at = header.find("'" + key + "':");
  if (at == std::string::npos) return "";
  const auto begin = header.find_first_not_of(' ', at + key.size() + 3);
  if (begin == std::string::npos) return "";
  const auto end = header.find(header[begin] == '(' ? ")" : ",", begin);
  return header.substr(begin, end - begin);
}

template <class T>
void convert(ByteView raw, std::vector<double>& out) {
  const auto values = to_values<T>(raw);
  out.assign(values.begin(), values.end());
}

// Conversions by NumPy's letter for the kind of the data type and its size in bytes.
const std::map<std::string, void (*)(ByteView, std::vector<double>&)> conversions{
    {"b1", convert<std::uint8_t>},  {"i1", convert<std::int8_t>},   {"u1", convert<std::uint8_t>},
    {"i2", convert<std::int16_t>},  {"u2", convert<std::uint16_t>}, {"i4", convert<std::int32_t>},
    {"u4", convert<std::uint32_t>}, {"f4", convert<float>},         {"i8", convert<std::int64_t>},
    {"u8", convert<std::uint64_t>}, {"f8", convert<double>}};

}  // namespace

NpyFile::NpyFile(const std::string& path) : path_(path), file_(path, ExitCode::failed) {
  read_header();
}

void NpyFile::refuse(const std::string& what) const {
  throw Error(ExitCode::failed, printable(path_) + ": " + what);
}

void NpyFile::read_header() {
  std::array<std::uint8_t, 12> head{};
  const std::size_t version_bytes =
      file_.read({head.data(), 10}) == 10 && std::memcmp(head.data(), "\x93NUMPY", 6) == 0
          ? head[6]
          : std::size_t{0};
  if (version_bytes < 1 || version_bytes > 3) refuse("is not a NumPy .npy file");
  const bool wide = head[6] > 1;
  if (wide && file_.read({head.data() + 10, 2}) != 2) refuse("header is truncated");
  ByteReader sizes({head.data() + 8, std::size_t{wide ? 4U : 2U}});
  const std::size_t length = wide ? sizes.get<std::uint32_t>() : sizes.get<std::uint16_t>();
  if (length > 65536) refuse("header is longer than 64 KiB");
  std::string header(length, ' ');
  if (file_.read({reinterpret_cast<std::uint8_t*>(header.data()), length}) != length)
    refuse("header is truncated");

  const std::string type = value_of(header, "descr");
  const bool little = type.size() == 5 && (type[1] == '<' || type[1] == '|');
  if (!little || !conversions.contains(type.substr(2, 2)))
    refuse("has type " + printable(type) +
           "; expected little-endian integers, or floats of 4 or 8 bytes");
  kind_ = type[2], item_bytes_ = static_cast<std::size_t>(type[3] - '0');
  if (value_of(header, "fortran_order") != "False")
    refuse("is in Fortran order; expected C order (numpy.ascontiguousarray)");

  const std::string shape = value_of(header, "shape");
  std::size_t values = 1;
  for (std::size_t at = 0; (at = shape.find_first_of("0123456789", at)) != std::string::npos;) {
    std::size_t used = 0;
    const std::uint64_t n = std::stoull(shape.substr(at, 19), &used);
    at += used;
    if (n != 0 && values > (std::size_t{1} << 48) / n) refuse("shape is too large");
    values *= n;
    if (!shape_.empty()) row_size_ *= n;
    shape_.push_back(n);
  }
  if (shape_.empty()) refuse("has no dimensions; expected one row per record");
  const std::size_t begin = 8 + (wide ? 4U : 2U) + length;
  if (file_.size() != begin + values * item_bytes_)
    refuse("has " + std::to_string(file_.size() - std::min(begin, file_.size())) +
           " bytes of values, but shape " + shape_text() + " requires " +
           std::to_string(values * item_bytes_));
}

std::string NpyFile::shape_text() const {
  std::string out;
  for (const std::size_t n : shape_) out += (out.empty() ? "[" : ", ") + std::to_string(n);
  return out + "]";
}

std::vector<double> NpyFile::next_row() {
  Bytes raw(row_size_ * item_bytes_);
  if (file_.read(raw) != raw.size()) refuse("ends before its last row");
  std::vector<double> out;
  conversions.at(kind_ + std::to_string(item_bytes_))(raw, out);
  return out;
}

std::string npy_header(const std::string& type, std::uint64_t rows,
                       const std::vector<std::size_t>& row_shape) {
  std::string shape = std::to_string(rows) + ",";
  for (const std::size_t n : row_shape) shape += " " + std::to_string(n) + ",";
  // Magic string, format version 1.0, and the length of the rest of the header (118 bytes).
  std::string out("\x93NUMPY\x01\x00\x76\x00", 10);
  out += "{'descr': '" + type + "', 'fortran_order': False, 'shape': (" + shape + "), }";
  out.resize(127, ' ');
  return out + '\n';
}

}  // namespace echofuse
