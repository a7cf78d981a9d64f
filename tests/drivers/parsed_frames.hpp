// SPDX-License-Identifier: MIT
// Parses streams of a radar's data port.
#pragma once
#include <chrono>
#include <cstdint>
#include <utility>

#include "../catch.hpp"
#include "drivers/radar/frame_parser.hpp"

namespace echofuse::test {

using Numbers = std::vector<std::uint32_t>;

struct ParsedFrames {
  std::vector<RadarFrame> frames;
  radar::FrameCounts counts;
  Numbers numbers() const {
    Numbers all;
    for (const RadarFrame& f : frames) all.push_back(f.frame_number);
    return all;
  }
};

// Feeds `bytes` to a parser in pieces. `piece` returns the size of the next piece. Piece i arrives
// after i seconds. Checks that every byte and every frame is counted.
template <class Piece>
ParsedFrames parse_frames(ByteView bytes, Piece piece) {
  radar::FrameParser parser(12);
  ParsedFrames parsed;
  const auto keep = [&](RadarFrame frame) { parsed.frames.push_back(std::move(frame)); };
  const std::size_t size = bytes.size();
  for (HostTime now{0}; !bytes.empty(); now += std::chrono::seconds(1)) {
    const std::size_t n = std::min<std::size_t>(bytes.size(), piece());
    parser.feed(bytes.first(n), now, keep);
    bytes = bytes.subspan(n);
  }
  parser.finish(keep);
  const radar::FrameCounts& c = parsed.counts = parser.counts();
  REQUIRE(c.bytes == size);
  REQUIRE(c.bytes == c.frame_bytes + c.junk_bytes + c.truncated_bytes);
  REQUIRE(c.frames == parsed.frames.size());
  return parsed;
}

inline ParsedFrames parse_frames(ByteView bytes) {
  return parse_frames(bytes, [&] { return bytes.size(); });
}

// Checks that the two results are equal, apart from the times of the frames.
inline void check_equal(const ParsedFrames& a, const ParsedFrames& b) {
  REQUIRE(a.numbers() == b.numbers());
  REQUIRE(std::ranges::equal(counters_of(a.counts), counters_of(b.counts), {}, &Counter::value,
                             &Counter::value));
}

}  // namespace echofuse::test
