// SPDX-License-Identifier: MIT
// Input: u8 seed for the split of the stream, then the stream of the data port.

#include "drivers/radar/frame_parser.hpp"
#include "fuzz.hpp"

using namespace echofuse::radar;

namespace {

constexpr std::uint8_t magic[] = {2, 1, 4, 3, 6, 5, 8, 7};

struct Header {
  std::uint64_t magic;
  std::uint32_t version, packet_bytes, platform, frame_number, cpu_cycles, objects, tlvs, subframe;
};

bool contains(ByteView all, ByteView part) {
  return std::search(all.begin(), all.end(), part.begin(), part.end()) != all.end();
}

struct Session {
  explicit Session(ByteView all) : stream(all) {}
  ByteView stream;
  FrameParser parser{1};
  std::vector<RadarFrame> frames{};
  std::uint64_t lost = 0;
  std::size_t searched = 0, fed = 0;

  void feed(ByteView bytes) {
    fed += bytes.size();
    parser.feed(bytes, HostTime{}, [this](RadarFrame frame) { take(std::move(frame)); });
    const FrameCounts& n = parser.counts();
    require(n.lost_frames == lost, "lost frames are reported with the next frame");
    require(n.bytes == fed && n.frame_bytes + n.junk_bytes + n.truncated_bytes <= fed,
            "no byte is used twice");
  }
  void take(RadarFrame frame) {
    const ByteView seen = stream.first(fed);
    while (!holds(seen.subspan(searched), frame)) {
      require(searched < fed, "the input contains each frame, in this order");
      ++searched;
    }
    ++searched;
    lost += frame.lost_before;
    frames.push_back(std::move(frame));
  }
  static bool holds(ByteView at, const RadarFrame& frame) {
    if (at.size() < sizeof(Header) || !std::equal(magic, magic + 8, at.begin())) return false;
    const auto header = ByteReader(at).get<Header>();
    return header.frame_number == frame.frame_number &&
           header.cpu_cycles == frame.time_cpu_cycles && header.packet_bytes <= at.size() &&
           std::ranges::all_of(frame.power, [](float p) { return p >= 1 && std::isfinite(p); }) &&
           contains(at.first(header.packet_bytes), as_bytes(frame.array));
  }
  void end() {
    parser.finish([this](RadarFrame frame) { take(std::move(frame)); });
    const FrameCounts& n = parser.counts();
    require(n.frame_bytes + n.junk_bytes + n.truncated_bytes == n.bytes, "every byte is counted");
    require(n.frames == frames.size(), "delivered frames are counted");
    require(n.lost_frames >= lost, "the end may only add losses");
    const auto profiles = std::count_if(frames.begin(), frames.end(),
                                        [](auto& frame) { return !frame.power.empty(); });
    const auto arrays = std::count_if(frames.begin(), frames.end(),
                                      [](auto& frame) { return !frame.array.empty(); });
    require(n.arrays == static_cast<std::uint64_t>(arrays), "heat maps are counted");
    require(std::all_of(frames.begin(), frames.end(),
                        [](auto& frame) { return frame.array.size() % 2 == 0; }),
            "a heat map has complete samples");
    require(n.range_profiles == static_cast<std::uint64_t>(profiles), "range profiles are counted");
  }
};

template <class T>
bool same_bytes(const std::optional<T>& a, const std::optional<T>& b) {
  return a.has_value() == b.has_value() && (!a || std::memcmp(&*a, &*b, sizeof(T)) == 0);
}

bool same(const RadarFrame& a, const RadarFrame& b) {
  return a.frame_number == b.frame_number && a.time_cpu_cycles == b.time_cpu_cycles &&
         a.lost_before == b.lost_before && a.power == b.power && a.array == b.array &&
         a.planar == b.planar && same_bytes(a.stats, b.stats) &&
         same_bytes(a.temperature, b.temperature);
}

bool same(const FrameCounts& a, const FrameCounts& b) {
  return std::ranges::equal(counters_of(a), counters_of(b), {}, &Counter::value, &Counter::value) &&
         a.last_frame_number == b.last_frame_number;
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const ByteView stream = input.subspan(1);
  Session whole(stream), pieces(stream);
  whole.feed(stream);
  in_pieces(stream, input[0], [&](ByteView piece) { pieces.feed(piece); });
  whole.end();
  pieces.end();
  require(std::equal(whole.frames.begin(), whole.frames.end(), pieces.frames.begin(),
                     pieces.frames.end(), [](auto& a, auto& b) { return same(a, b); }),
          "any split gives the same frames");
  require(same(whole.parser.counts(), pieces.parser.counts()), "and the same counters");
}
