// SPDX-License-Identifier: MIT

#include "drivers/core/random.hpp"
#include "drivers/radar/log2_codes.hpp"
#include "hex.hpp"
#include "parsed_frames.hpp"

using namespace echofuse::radar;
using namespace echofuse::test;

namespace {

constexpr std::uint32_t antennas = 12;

const std::vector<Bytes>& golden() {
  static const auto pieces = read_golden("radar.hex");
  return pieces;
}

void set_u32(Bytes& bytes, std::size_t at, std::uint32_t value) {
  std::memcpy(bytes.data() + at, &value, 4);
}

}  // namespace

TEST_CASE("golden radar frames are parsed") {
  const ParsedFrames p = parse_frames(join(golden()));
  REQUIRE(p.numbers() == Numbers{209, 210, 213});
  std::vector<float> profile;
  for (const std::uint16_t code :
       std::initializer_list<std::uint16_t>{5000, 6000, 65535, 0, 1, 258, 772, 4097})
    profile.push_back(power_from_code(code, antennas));
  CHECK(profile[0] == Approx(std::exp2(5000 / 96.)));
  CHECK(profile[2] == std::exp2(127.f));
  for (const RadarFrame& f : p.frames) CHECK(f.power == profile);
  const RadarFrame& first = p.frames[0];
  CHECK(first.time_cpu_cycles == 20'000'000);
  REQUIRE(first.stats);
  CHECK(first.stats->inter_frame_processing_us == 4000);
  CHECK(first.stats->transmit_us == 8591);
  CHECK(first.stats->inter_frame_load_percent == 2);
  CHECK_FALSE(first.temperature);
  const RadarFrame& second = p.frames[1];
  REQUIRE(second.temperature);
  CHECK(second.temperature->invalid == 0);
  CHECK(second.temperature->time_ms == 123'456);
  CHECK(second.temperature->celsius[7] == -3);
  CHECK(p.frames[2].lost_before == 2);
  CHECK_FALSE(p.frames[2].stats);
  CHECK(p.counts.bytes == 352);
  CHECK(p.counts.frames == 3);
  CHECK(p.counts.range_profiles == 3);
  CHECK(p.counts.other_tlvs == 1);
  CHECK(p.counts.lost_frames == 2);
  CHECK(p.counts.last_frame_number == 213u);
  CHECK(p.counts.junk_bytes + p.counts.truncated_bytes + p.counts.resyncs == 0);
}

TEST_CASE("golden radar heat maps are parsed") {
  const auto pieces = read_golden("radar_array.hex");
  const ParsedFrames p = parse_frames(join(pieces));
  REQUIRE(p.numbers() == Numbers{301, 302, 303, 304});
  const auto check = [](const RadarFrame& f, std::size_t antennas) {
    REQUIRE(f.array.size() == 2 * 4 * antennas);
    // Each sample is stored as the imaginary part followed by the real part.
    CHECK(f.array[0] == -32768);
    CHECK(f.array[1] == 32767);
    CHECK(f.array[2 * (3 * antennas + 5)] == 305);
    CHECK(f.array[2 * (3 * antennas + 5) + 1] == -1305);
    CHECK(f.array[2 * antennas - 2] == static_cast<int>(antennas) - 1);
  };
  check(p.frames[0], 8);
  check(p.frames[1], 12);
  check(p.frames[2], 8);  // the first of two heat map TLVs is used
  CHECK_FALSE(p.frames[0].planar);
  CHECK(p.frames[1].planar);
  CHECK_FALSE(p.frames[2].planar);
  CHECK(p.frames[3].array.empty());
  for (const RadarFrame& f : p.frames) CHECK(f.power.size() == 4);
  CHECK(p.frames[0].stats);
  CHECK(p.counts.arrays == 3);
  CHECK(p.counts.other_tlvs == 2);
  CHECK(p.counts.bad_tlvs + p.counts.truncated_frames + p.counts.junk_bytes == 0);
}

TEST_CASE(
    "radar frames do not depend on how bytes are split, and have the time of their last byte") {
  const Bytes all = join(golden());
  for (std::size_t cut = 1; cut < all.size(); ++cut) {
    std::size_t next = cut;
    const ParsedFrames p = parse_frames(all, [&] { return std::exchange(next, all.size()); });
    REQUIRE(p.numbers() == Numbers{209, 210, 213});
    CHECK(p.counts.junk_bytes == 0);
    CHECK(p.frames[0].received == std::chrono::seconds(cut >= golden()[0].size() ? 0 : 1));
  }
  const ParsedFrames bytewise = parse_frames(all, [] { return 1; });
  CHECK(bytewise.numbers() == Numbers{209, 210, 213});
  CHECK(bytewise.frames[0].received == std::chrono::seconds(golden()[0].size() - 1));
}

TEST_CASE("junk before, between and after radar frames is skipped and counted") {
  // The firmware sends these bytes if configDataPort is called with ackPing.
  const Bytes junk(16, 0xff);
  const auto& g = golden();
  const ParsedFrames p = parse_frames(join({junk, g[0], junk, g[1], junk}));
  CHECK(p.numbers() == Numbers{209, 210});
  CHECK(p.counts.junk_bytes == 48);
  CHECK(p.counts.resyncs == 2);
}

TEST_CASE("a radar frame with missing bytes counts as truncated, and the next frame is complete") {
  const auto& g = golden();
  for (std::size_t lost = 1; lost < g[0].size() - 40; ++lost)
    for (const std::size_t at : {std::size_t{40}, g[0].size() - lost}) {
      Bytes shorter = g[0];
      shorter.erase(shorter.begin() + static_cast<std::ptrdiff_t>(at),
                    shorter.begin() + static_cast<std::ptrdiff_t>(at + lost));
      const ParsedFrames p = parse_frames(join({shorter, g[1]}));
      CAPTURE(lost, at);
      REQUIRE(p.numbers() == Numbers{210});
      REQUIRE(p.counts.truncated_frames == 1);
      REQUIRE(p.counts.truncated_bytes == shorter.size());
    }
}

TEST_CASE("a damaged field of a radar frame loses at most this frame and is counted") {
  const auto& g = golden();
  // The length of the frame (12), the number of its TLVs (32) and the length of its first TLV (44).
  const auto [at, value, counter] =
      GENERATE(table<std::size_t, std::uint32_t, std::uint64_t FrameCounts::*>(
          {{12, 39u, &FrameCounts::bad_headers},
           {12, 63u, &FrameCounts::bad_headers},
           {12, 65'537u, &FrameCounts::bad_headers},
           {12, 0u, &FrameCounts::bad_headers},
           {12, 0xffffffffu, &FrameCounts::bad_headers},
           {12, 60'000u, &FrameCounts::truncated_frames},
           {32, 17u, &FrameCounts::bad_headers},
           {32, 1u, &FrameCounts::bad_tlvs},
           {44, 5000u, &FrameCounts::bad_tlvs}}));
  CAPTURE(at, value);
  Bytes bad = g[1];
  set_u32(bad, at, value);
  const ParsedFrames p = parse_frames(join({g[0], bad, g[2]}));
  CHECK(p.numbers() == Numbers{209, 213});
  CHECK(p.counts.range_profiles == 2);
  CHECK(p.counts.lost_frames == 3);
  const std::uint64_t count = p.counts.*counter;
  CHECK((counter == &FrameCounts::bad_headers ? count > 0 : count == 1));
}

TEST_CASE("a radar frame with a TLV count that is one too high keeps its TLVs") {
  const int padding = GENERATE(0, 15, 255);
  Bytes bad = golden()[1];  // a frame with 20 bytes of padding
  std::fill(bad.end() - 20, bad.end(), static_cast<std::uint8_t>(padding));
  set_u32(bad, 32, 4);
  const ParsedFrames p = parse_frames(bad);
  REQUIRE(p.numbers() == Numbers{210});
  CHECK(p.counts.excess_tlvs == 1);
  CHECK(p.counts.bad_tlvs + p.counts.other_tlvs == 0);
  CHECK(p.frames[0].temperature);
}

TEST_CASE(
    "radar padding that resembles a magic word is recognised by the next bytes or by silence") {
  Bytes doubtful = golden()[2];
  doubtful.back() = 2;  // the last byte is 2, which may be the first byte of a magic word
  FrameParser parser(antennas);
  std::vector<RadarFrame> frames;
  const auto keep = [&](RadarFrame f) { frames.push_back(std::move(f)); };
  const HostTime whole{1000}, later{2000};
  parser.feed(doubtful, whole, keep);
  REQUIRE(frames.empty());
  REQUIRE(parser.in_doubt());
  SECTION("a radar frame with doubtful padding is delivered after silence") {
    parser.resolve(keep);
    CHECK_FALSE(parser.in_doubt());
    REQUIRE(frames.size() == 1);
    parser.resolve(keep);
    parser.feed(golden()[2], later, keep);
  }
  SECTION("a radar frame with doubtful padding is delivered when the next frame arrives") {
    parser.feed(golden()[2], later, keep);
  }
  REQUIRE(frames.size() == 2);
  CHECK(frames[0].received == whole);
  CHECK(frames[1].received == later);
  CHECK(frames[0].frame_number == frames[1].frame_number);
}

TEST_CASE("the radar frame parser can be used again after finish()") {
  FrameParser parser(antennas);
  Numbers numbers;
  const auto keep = [&](const RadarFrame& f) { numbers.push_back(f.frame_number); };
  parser.feed(ByteView(golden()[0]).first(60), HostTime{}, keep);
  parser.finish(keep);
  parser.feed(join({golden()[1], golden()[2]}), HostTime{}, keep);
  parser.finish(keep);
  CHECK(numbers == Numbers{210, 213});
  CHECK(parser.counts().truncated_frames == 1);
}
