// SPDX-License-Identifier: MIT
// Radar data port -> frames: every byte is in a frame, junk or truncated.
#include "drivers/radar/frame_parser.hpp"
#include "fuzz.hpp"

using namespace echofuse;
using namespace echofuse::fuzz;

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  radar::FrameParser parser;
  std::uint64_t frames = 0, profiles = 0, lost = 0;
  const auto take = [&](const RadarFrame& frame) {
    ++frames;
    profiles += !frame.range_profile.empty();
    lost += frame.lost_before;
  };
  in_pieces({data, size}, [&](ByteView piece) { parser.feed(piece, HostTime{}, take); });
  parser.finish(take);
  const radar::FrameCounts& c = parser.counts();
  require(c.bytes == (size > 0 ? size - 1 : 0), "every byte is counted");
  require(c.bytes == c.frame_bytes + c.junk_bytes + c.truncated_bytes, "bytes add up");
  require(c.frames == frames && c.lost_frames == lost, "the counters are those of the frames");
  require(profiles <= c.range_profiles && c.range_profiles <= frames, "profiles are of frames");
  require(40 * c.frames <= c.frame_bytes, "a frame has its header");
  return 0;
}
