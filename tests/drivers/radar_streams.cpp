// SPDX-License-Identifier: MIT
// Tests data streams like those of other boards and labs. The streams are built byte by byte,
// without the encoder of the simulator. They contain different headers with the same magic word,
// different TLVs, partial frames at the start and at the end, and frames shorter than the length in
// their header.
#include "drivers/core/random.hpp"
#include "parsed_frames.hpp"

using namespace echofuse::radar;
using namespace echofuse::test;

namespace {

struct Tlv {
  std::uint32_t type;
  std::size_t bytes;
};

// Format of frames that have the demo's 40-byte header. Frames are padded to a multiple of `unit`
// bytes.
struct Lab {
  std::uint32_t version = 0x03030002, platform = 0xa6843;
  std::vector<Tlv> tlvs;
  std::size_t unit = 32;
};

void put_magic(Bytes& out) { put(out, std::uint64_t{0x0708050603040102}); }

void put_payload(Bytes& out, std::size_t bytes, std::uint32_t seed) {
  for (std::size_t i = 0; i < bytes; ++i)
    out.push_back(static_cast<std::uint8_t>(seed * 31 + i * 7));
}

Bytes frame_of(const Lab& lab, std::uint32_t number) {
  std::size_t size = 40;
  for (const Tlv& t : lab.tlvs) size += 8 + t.bytes;
  size = (size + lab.unit - 1) / lab.unit * lab.unit;
  Bytes out;
  put_magic(out);
  for (const std::uint32_t field :
       {lab.version, static_cast<std::uint32_t>(size), lab.platform, number, number * 20'000'000,
        0u, static_cast<std::uint32_t>(lab.tlvs.size()), 0u})
    put(out, field);
  for (const Tlv& t : lab.tlvs) {
    put(out, t.type);
    put(out, static_cast<std::uint32_t>(t.bytes));
    put_payload(out, t.bytes, number);
  }
  while (out.size() < size) out.push_back(0x55);
  return out;
}

// Returns a frame in the format of the newer people-counting demos. The header has 48 bytes and
// ends with the number of TLVs (u16) and the checksum (u16).
Bytes frame_48(std::uint32_t number, std::uint32_t track_us) {
  Bytes out;
  put_magic(out);
  constexpr std::uint32_t size = 48 + 8 + 84;
  for (const std::uint32_t field :
       {0x03050004u, size, 0xa6843u, number, 0u, 9000u, 80'000u, track_us, 3000u})
    put(out, field);
  put(out, std::uint16_t{1});
  put(out, static_cast<std::uint16_t>(0xbeef + number));
  put(out, std::uint32_t{1020});
  put(out, std::uint32_t{84});
  put_payload(out, 84, number);
  return out;
}

// Returns a frame in the format of the older people-counting demos. The header has 52 bytes. The
// platform and the time precede the length.
Bytes frame_52(std::uint32_t number) {
  Bytes out;
  put_magic(out);
  constexpr std::uint32_t size = 52 + 8 + 40;
  for (const std::uint32_t field :
       {0x01000005u, 0xa1642u, number * 10'000'000, size, number, 0u, 9000u, 80'000u, 500u, 3000u})
    put(out, field);
  put(out, std::uint16_t{1});
  put(out, static_cast<std::uint16_t>(0x1234 + number));
  put(out, std::uint32_t{7});
  put(out, std::uint32_t{48});  // the TLV length includes the TLV header
  put_payload(out, 40, number);
  return out;
}

const Lab demo{.tlvs = {{1, 0}, {2, 512}, {6, 24}, {9, 28}}};
const Lab azimuth{
    .tlvs = {{2, 512}, {4, 8192}, {6, 24}, {9, 28}}};  // TLV type 4 contains 256 bins of 8 antennas
const Lab vital_signs{.version = 0x02000004, .platform = 0xa1642, .tlvs = {{6, 128}, {2, 76}}};
const Lab exact{.tlvs = {{2, 76}, {1010, 30}}, .unit = 1};  // frames without padding

template <class Make>
Bytes stream(std::uint32_t count, const Make& make) {
  Bytes all;
  for (std::uint32_t i = 1; i <= count; ++i) {
    const Bytes one = make(i);
    all.insert(all.end(), one.begin(), one.end());
  }
  return all;
}
Bytes stream(std::uint32_t count, const Lab& lab) {
  return stream(count, [&](std::uint32_t i) { return frame_of(lab, i); });
}

// Parses the bytes as a whole and in pieces. Checks that the results match.
ParsedFrames parse(ByteView bytes) {
  const ParsedFrames whole = parse_frames(bytes);
  for (const std::size_t piece : {1u, 61u})
    check_equal(whole, parse_frames(bytes, [=] { return piece; }));
  return whole;
}

// Checks that all frames have `bins` range bins.
void check_bins(const ParsedFrames& s, std::size_t bins) {
  for (const RadarFrame& f : s.frames) CHECK(f.power.size() == bins);
}

Numbers from_to(std::uint32_t first, std::uint32_t last) {
  Numbers all;
  for (std::uint32_t i = first; i <= last; ++i) all.push_back(i);
  return all;
}

Bytes part(const Bytes& whole, std::size_t from, std::size_t to) {
  return {whole.begin() + static_cast<std::ptrdiff_t>(from),
          whole.begin() + static_cast<std::ptrdiff_t>(to)};
}

}  // namespace

TEST_CASE("a stream of heat maps loses one frame if it starts, ends or has a gap at any byte") {
  const Bytes all = stream(3, azimuth);
  const std::size_t size = all.size() / 3;
  CHECK(size == 8832);
  for (std::size_t at = 1; at < size; at += 397) {
    CAPTURE(at);
    const ParsedFrames late = parse(part(all, at, all.size())),
                       early = parse(part(all, 0, 2 * size + at));
    REQUIRE(late.numbers() == from_to(2, 3));
    REQUIRE(early.numbers() == from_to(1, 2));
    REQUIRE(late.counts.arrays == 2);
    Bytes hole = all;  // stream with a gap like that caused by a buffer overflow
    const auto from = hole.begin() + static_cast<std::ptrdiff_t>(at);
    hole.erase(from, from + 256);
    const ParsedFrames s = parse(hole);
    REQUIRE(s.counts.arrays == s.counts.frames);
    REQUIRE(s.numbers().back() == 3);
    REQUIRE(s.numbers().size() + s.counts.lost_frames + (s.numbers()[0] - 1) == 3);
  }
}

TEST_CASE("a stream that starts or ends within a radar frame loses only that frame") {
  const Bytes late = stream(4, demo), early = stream(3, exact);
  const std::size_t size = late.size() / 4, exact_size = early.size() / 3;
  for (std::size_t from = 1; from < size; from += 7) {
    const ParsedFrames s = parse(part(late, from, late.size()));
    REQUIRE(s.numbers() == from_to(2, 4));
    REQUIRE(s.counts.junk_bytes == size - from);
    REQUIRE(s.counts.resyncs == 1);
  }
  for (std::size_t cut = 1; cut < exact_size; ++cut) {
    const ParsedFrames s = parse(part(early, 0, early.size() - cut));
    REQUIRE(s.numbers() == from_to(1, 2));
    REQUIRE(s.counts.truncated_bytes + s.counts.junk_bytes == exact_size - cut);
  }
}

TEST_CASE(
    "TLVs that the radar parser does not use, also of other TI demos, are counted and skipped") {
  // TLV type 6 of the vital signs demo is not decoded as statistics.
  for (const auto& [lab, bins] : {std::pair(&demo, 256), {&vital_signs, 38}, {&exact, 38}}) {
    const ParsedFrames s = parse(stream(30, *lab));
    CHECK(s.numbers() == from_to(1, 30));
    CHECK(s.counts.other_tlvs == 30);
    CHECK(s.counts.junk_bytes == 0);
    check_bins(s, static_cast<std::size_t>(bins));
  }
}

TEST_CASE("radar frames of other TI demos with the same magic word are refused one by one") {
  SECTION("a radar frame with a 48-byte header is refused") {
    for (const std::uint32_t track_us : {0u, 1u, 16u, 400u, 100'000u}) {
      const ParsedFrames s =
          parse(stream(60, [&](std::uint32_t i) { return frame_48(i, track_us); }));
      CAPTURE(track_us);
      CHECK(s.numbers().empty());
      CHECK(s.counts.bad_headers + s.counts.bad_tlvs == 60);
    }
  }
  SECTION("a radar frame with a 52-byte header is refused") {
    const ParsedFrames s = parse(stream(60, frame_52));
    CHECK(s.numbers().empty());
    CHECK(s.counts.bad_headers == 60);
    CHECK(s.counts.junk_bytes == s.counts.bytes);
  }
  SECTION("valid radar frames between refused frames are delivered") {
    const ParsedFrames s = parse(stream(60, [](std::uint32_t i) {
      return i % 3 == 0 ? frame_48(i, 300) : i % 3 == 1 ? frame_52(i) : frame_of(demo, i);
    }));
    CHECK(s.counts.frames == 20);
    check_bins(s, 256);
  }
}

TEST_CASE("a jump in radar frame numbers is accepted if the number of the next frame confirms it") {
  const auto lost = [](const Numbers& numbers) {
    FrameParser parser(1);
    std::uint64_t sum = 0;
    const auto add = [&](const RadarFrame& f) { sum += f.lost_before; };
    for (const std::uint32_t n : numbers) parser.feed(frame_of(exact, n), HostTime{}, add);
    parser.finish(add);
    const FrameCounts& c = parser.counts();
    CHECK(c.frames == numbers.size());
    CHECK(c.lost_frames >= sum);
    return std::pair(c.lost_frames, c.restarts);
  };
  using Result = std::pair<std::uint64_t, std::uint64_t>;
  CHECK(lost({7, 8, 11, 12}) == Result{2, 0});
  CHECK(lost({7, 8, 5000, 5001}) == Result{4991, 0});
  CHECK(lost({7, 8, 5000}) == Result{4991, 0});  // only the last number jumps, by 4992
  // A flipped bit in a frame number does not cause frames to be counted as lost.
  CHECK(lost({7, 8, 9 + (1u << 18), 10, 11}) == Result{0, 0});
  CHECK(lost({7, 8, 9 + (1u << 30), 10, 11}) == Result{0, 0});
  CHECK(lost({70, 71, 8, 73, 74}) == Result{0, 0});
  CHECK(lost({70, 71, 8, 75, 76}) == Result{2, 0});
  // Repeated frame numbers are not counted as lost frames.
  CHECK(lost({70, 71, 70, 71, 72}) == Result{0, 0});
  CHECK(lost({500, 501, 1, 2, 3}) == Result{0, 1});  // the board was reset after frame 501
  // The board was reset. After the reset, frames 2 and 4 to 499 were lost.
  CHECK(lost({500, 501, 1, 3, 500, 501}) == Result{1 + 496, 1});
  CHECK(lost({0xfffffffe, 0xffffffff, 0, 1}) == Result{0, 0});  // the frame counter wraps around
}

TEST_CASE("frames lost at the end of a connection are counted with the next frame that arrives") {
  FrameParser parser(1);
  std::vector<std::uint32_t> lost;
  const auto add = [&](const RadarFrame& f) { lost.push_back(f.lost_before); };
  for (const std::uint32_t n : {7u, 8u, 500u}) parser.feed(frame_of(exact, n), HostTime{}, add);
  parser.finish(add);
  for (const std::uint32_t n : {503u, 504u}) parser.feed(frame_of(exact, n), HostTime{}, add);
  CHECK(lost == std::vector<std::uint32_t>{0, 0, 0, 491 + 2, 0});
  CHECK(parser.counts().lost_frames == 491 + 2);
}

TEST_CASE("the radar parser delivers all complete frames and no others under random faults") {
  for (std::uint32_t seed = 1; seed <= 150; ++seed) {
    Rng rng = make_rng(seed, 6);
    Bytes bytes;
    Numbers whole;
    for (std::uint32_t i = 1; i <= 20; ++i) {
      const auto kind = rng() % 10;
      Bytes one = kind == 0   ? frame_48(i, static_cast<std::uint32_t>(rng() % 20))
                  : kind == 1 ? frame_52(i)
                  : kind == 2 ? frame_of(Lab{.tlvs = vital_signs.tlvs}, i)
                              : frame_of(demo, i);
      if (kind == 3) one.resize(1 + rng() % (one.size() - 33));  // removes more than the padding
      if (kind == 4) one.assign(rng() % 300, static_cast<std::uint8_t>(rng() % 9));
      if (kind == 2 || kind > 4) whole.push_back(i);
      bytes.insert(bytes.end(), one.begin(), one.end());
    }
    const ParsedFrames s = parse(bytes);
    CAPTURE(seed);
    REQUIRE(s.numbers() == whole);
  }
}
