// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <deque>

#include "drivers/core/bytes.hpp"

namespace echofuse::bridge {

// The CRC-32C of any stretch of a stream, where stretches overlap: each byte is read once for all
// of them, and each stretch costs no more than two pieces of 256 bytes.
class StretchCrc {
 public:
  // crc32c of bytes.subspan(from, count), chained to `crc`. `place` is where in the stream `bytes`
  // begin; neither it nor place + from ever goes back.
  std::uint32_t of(ByteView bytes, std::uint64_t place, std::size_t from, std::size_t count,
                   std::uint32_t crc);
  void clear() { marks_.clear(); }

 private:
  // At every 256th byte of the stream from first_ on: the CRC of the bytes since the mark at which
  // they were begun.
  std::deque<std::uint32_t> marks_;
  std::uint64_t first_ = 0;  // place of the first
};

}  // namespace echofuse::bridge
