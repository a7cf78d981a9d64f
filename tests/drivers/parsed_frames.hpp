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

// Lists the counters that are not 0.
inline std::string line_of(const std::vector<Counter>& counters) {
  std::string line;
  for (const Counter& c : counters)
    if (c.value > 0) line += c.name + (" " + std::to_string(c.value) + ", ");
  return line;
}

struct ParsedFrames {
  std::vector<RadarFrame> frames;
  radar::FrameCounts counts;
  Numbers numbers() const {
    Numbers all;
    for (const RadarFrame& f : frames) all.push_back(f.frame_number);
    return all;
  }
  // Lists the counters, and the number and the sizes of each frame.
  std::string line() const {
    std::ostringstream delivered;
    for (const RadarFrame& f : frames)
      delivered << ' ' << f.frame_number << '/' << f.power.size() << '/' << f.array.size();
    return line_of(counters_of(counts)) + "delivered:" + delivered.str();
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

}  // namespace echofuse::test
