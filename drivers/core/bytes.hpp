// SPDX-License-Identifier: MIT
// Bounds-checked little-endian access to wire bytes. A read past the end returns zeros and clears
// ok(). A parser checks ok() once after a group of fields.
#pragma once
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <type_traits>
#include <vector>

namespace echofuse {

static_assert(std::endian::native == std::endian::little,
              "wire formats are little-endian and read without conversion");

using Bytes = std::vector<std::uint8_t>;
using ByteView = std::span<const std::uint8_t>;

class ByteReader {
 public:
  explicit ByteReader(ByteView bytes) : bytes_(bytes) {}

  template <class T>
  T get() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    const ByteView raw = take(sizeof(T));
    if (!raw.empty()) std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }
  // Returns the next n bytes, or an empty view if fewer than n are left.
  ByteView take(std::size_t n) {
    if (n > bytes_.size()) {
      ok_ = false;
      bytes_ = {};
      return {};
    }
    const ByteView head = bytes_.first(n);
    bytes_ = bytes_.subspan(n);
    return head;
  }
  bool ok() const { return ok_; }
  std::size_t left() const { return bytes_.size(); }

 private:
  ByteView bytes_;
  bool ok_ = true;
};

template <class T>
void put(Bytes& out, T value) {
  static_assert(std::is_trivially_copyable_v<T>);
  const std::size_t size = out.size();
  out.resize(size + sizeof(T));
  std::memcpy(out.data() + size, &value, sizeof(T));
}

// Converts raw bytes to values of type T. Ignores trailing bytes that do not form a complete value.
template <class T>
std::vector<T> to_values(ByteView raw) {
  static_assert(std::is_trivially_copyable_v<T>);
  std::vector<T> values(raw.size() / sizeof(T));
  if (!values.empty()) std::memcpy(values.data(), raw.data(), values.size() * sizeof(T));
  return values;
}

template <class T>
ByteView as_bytes(const std::vector<T>& values) {
  static_assert(std::is_trivially_copyable_v<T>);
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size() * sizeof(T)};
}

}  // namespace echofuse
