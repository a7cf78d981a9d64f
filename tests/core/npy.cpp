// SPDX-License-Identifier: MIT
#include "drivers/util/npy.hpp"

#include <cstdint>

#include "../fixtures/folder.hpp"
#include "drivers/core/bytes.hpp"

namespace {

// Writes a .npy file with two rows of two values, and checks that the reader returns the values.
template <class T>
void check_type(const std::string& type) {
  CAPTURE(type);
  constexpr T least = std::numeric_limits<T>::lowest(), most = std::numeric_limits<T>::max();
  const std::vector<T> values{least, T(1), static_cast<T>(T(0) - T(1)), most};
  const test::Folder folder;
  const std::string path = folder / "a.npy";
  const ByteView raw = as_bytes(values);
  std::ofstream(path, std::ios::binary)
      << npy_header(type, 2, {2}) << std::string(raw.begin(), raw.end());
  NpyFile file(path);
  for (std::size_t row = 0; row < 2; ++row) {
    const std::vector<double> read = file.next_row();
    REQUIRE(read.size() == 2);
    for (std::size_t i = 0; i < 2; ++i) CHECK(read[i] == static_cast<double>(values[2 * row + i]));
  }
}

}  // namespace

TEST_CASE("a .npy file of each type is read with its extreme, negative and small values") {
  check_type<std::int8_t>("|i1");
  check_type<std::uint8_t>("|u1");
  check_type<std::int16_t>("<i2");
  check_type<std::uint16_t>("<u2");
  check_type<std::int32_t>("<i4");
  check_type<std::uint32_t>("<u4");
  check_type<std::int64_t>("<i8");
  check_type<std::uint64_t>("<u8");
  check_type<float>("<f4");
  check_type<double>("<f8");
}
