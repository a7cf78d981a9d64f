// SPDX-License-Identifier: MIT
#include "drivers/core/crc32c.hpp"

#include <isa-l/crc.h>

#include <algorithm>
#include <array>

namespace echofuse {
namespace {

// The product of two polynomials modulo that of the CRC; bit 31 stands for 1, bit 30 for x.
constexpr std::uint32_t product(std::uint32_t a, std::uint32_t b) {
  std::uint32_t sum = 0;
  for (; a != 0; a <<= 1) {
    if (a & 0x80000000U) sum ^= b;
    b = (b & 1) ? (b >> 1) ^ 0x82f63b78U : b >> 1;
  }
  return sum;
}

// x to the power of 8 * 2^i: a shift by 2^i bytes.
constexpr std::array<std::uint32_t, 64> make_shifts() {
  std::array<std::uint32_t, 64> shifts{};
  std::uint32_t power = 0x80000000U >> 8;
  for (auto& shift : shifts) {
    shift = power;
    power = product(power, power);
  }
  return shifts;
}
constexpr auto shifts = make_shifts();

}  // namespace

std::uint32_t crc32c(ByteView bytes, std::uint32_t crc) {
  constexpr std::size_t most = std::size_t{1} << 30;  // ISA-L counts in an int
  for (crc = ~crc; !bytes.empty(); bytes = bytes.subspan(std::min(bytes.size(), most)))
    crc = ::crc32_iscsi(const_cast<std::uint8_t*>(bytes.data()),
                        static_cast<int>(std::min(bytes.size(), most)), crc);
  return ~crc;
}

std::uint32_t crc32c_shift(std::uint32_t crc, std::uint64_t count) {
  for (std::size_t i = 0; count != 0; ++i, count >>= 1)
    if (count & 1) crc = product(shifts[i], crc);
  return crc;
}

}  // namespace echofuse
