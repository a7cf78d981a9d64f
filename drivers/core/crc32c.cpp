// SPDX-License-Identifier: MIT
#include "drivers/core/crc32c.hpp"

#include <isa-l/crc.h>

#include <algorithm>

namespace echofuse {

std::uint32_t crc32c(ByteView bytes, std::uint32_t crc) {
  // maximum number of bytes passed to ISA-L in one call, because ISA-L takes the length as an int
  constexpr std::size_t max_chunk = std::size_t{1} << 30;
  for (crc = ~crc; !bytes.empty(); bytes = bytes.subspan(std::min(bytes.size(), max_chunk)))
    crc = ::crc32_iscsi(const_cast<std::uint8_t*>(bytes.data()),
                        static_cast<int>(std::min(bytes.size(), max_chunk)), crc);
  return ~crc;
}

}  // namespace echofuse
