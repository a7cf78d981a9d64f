// SPDX-License-Identifier: MIT
#include "recon/files/npy.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

#include "drivers/core/exit_code.hpp"
#include "drivers/core/printable.hpp"
#include "recon/files/files.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t longest_header = 65535, most_dimensions = 32;  // NumPy's own

// The text behind 'key': in the header, up to `end`.
std::string value_of(const std::string& header, const std::string& key, char end) {
  const auto at = header.find("'" + key + "':");
  if (at == std::string::npos) return {};
  const auto first = header.find_first_not_of(' ', at + key.size() + 3);
  const auto last = header.find(end, first);
  return last == std::string::npos ? std::string{} : header.substr(first, last - first);
}

// "(60, 91" -> 60, 91; "(60," -> 60; "(" -> none. Nothing if it is no such text.
std::optional<std::vector<std::size_t>> shape_of(std::string_view text) {
  std::vector<std::size_t> out;
  if (!text.starts_with('(')) return {};
  for (text.remove_prefix(1);;) {
    text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
    if (text.empty()) return out;
    std::size_t n = 0;
    const auto [next, error] = std::from_chars(text.data(), text.data() + text.size(), n);
    if (error != std::errc() || out.size() == most_dimensions) return {};
    out.push_back(n);
    text.remove_prefix(static_cast<std::size_t>(next - text.data()));
    text.remove_prefix(std::min(text.find_first_not_of(' '), text.size()));
    if (text.empty()) return out;
    if (!text.starts_with(',')) return {};
    text.remove_prefix(1);
  }
}

template <class T>
std::vector<float> floats(ByteView raw) {
  const auto values = to_values<T>(raw);
  return {values.begin(), values.end()};
}
template <>
std::vector<float> floats<double>(ByteView raw) {
  std::vector<float> out;
  for (const double v : to_values<double>(raw)) out.push_back(static_cast<float>(v));
  return out;
}

// The first index runs fastest in the file; it shall run slowest.
std::vector<float> to_row_major(const std::vector<float>& in,
                                const std::vector<std::size_t>& shape) {
  std::vector<float> out(in.size());
  std::vector<std::size_t> index(shape.size());
  for (const float v : in) {
    std::size_t at = 0;
    for (std::size_t d = 0; d < shape.size(); ++d) at = at * shape[d] + index[d];
    out[at] = v;
    for (std::size_t d = 0; d < shape.size() && ++index[d] == shape[d]; ++d) index[d] = 0;
  }
  return out;
}

}  // namespace

NpyArray read_npy(const std::string& path) { return parse_npy(read_file(path), path); }

NpyArray parse_npy(ByteView bytes, const std::string& path) {
  const auto fail = [&](const std::string& what) {
    throw Error(ExitCode::failed, path + ": " + what);
  };
  ByteReader in(bytes);
  const ByteView magic = in.take(6);
  if (magic.empty() || std::memcmp(magic.data(), "\x93NUMPY", 6) != 0)
    fail("not a NumPy array file");
  const auto major = in.get<std::uint8_t>();
  in.get<std::uint8_t>();
  if (major < 1 || major > 3)
    fail("has version " + std::to_string(major) + " of NumPy's format; expected 1, 2 or 3");
  const std::size_t length = major == 1 ? in.get<std::uint16_t>() : in.get<std::uint32_t>();
  if (length > longest_header)
    fail("has a header of " + std::to_string(length) + " bytes; expected at most " +
         std::to_string(longest_header));
  const ByteView text = in.take(length);
  if (!in.ok()) fail("cut off in its header");
  const std::string header(text.begin(), text.end());
  const std::string type = value_of(header, "descr", ',');
  if (type != "'<f4'" && type != "'<f8'")
    fail("holds " + printable(type.substr(0, 40)) + "; expected '<f4' or '<f8'");
  const std::string order = value_of(header, "fortran_order", ',');
  if (order != "True" && order != "False") fail("says not whether it is in Fortran's order");

  NpyArray out;
  const auto shape = shape_of(value_of(header, "shape", ')'));
  if (!shape) fail("has no shape that can be read; expected one like (60, 91)");
  out.shape = *shape;
  std::size_t wanted = 1;
  for (const std::size_t n : out.shape)  // a shape of more values than bytes overflows nothing
    wanted = n == 0 || wanted <= in.left() / n ? wanted * n : in.left() + 1;
  const std::size_t width = type == "'<f4'" ? 4 : 8;
  if (in.left() != wanted * width)
    fail("has " + std::to_string(in.left()) + " bytes of values; its shape asks for " +
         std::to_string(wanted * width));
  const ByteView values = in.take(in.left());
  out.values = width == 4 ? floats<float>(values) : floats<double>(values);
  if (order == "True") out.values = to_row_major(out.values, out.shape);
  for (std::size_t i = 0; i < out.values.size(); ++i)
    if (!std::isfinite(out.values[i]))
      fail("value " + std::to_string(i) + " is not a finite number");
  return out;
}

}  // namespace echofuse::recon
