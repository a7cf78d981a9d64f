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

// The following streams are like those of other boards and labs. They are built byte by byte,
// without the encoder of the simulator. They contain different headers with the same magic word,
// different TLVs, partial frames at the start and at the end, and frames shorter than the length in
// their header.
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

// Returns the magic word, these fields and a payload.
Bytes frame(std::initializer_list<std::uint32_t> fields, std::size_t payload_bytes = 0,
            std::uint32_t seed = 0) {
  Bytes out;
  put(out, std::uint64_t{0x0708050603040102});
  for (const std::uint32_t field : fields) put(out, field);
  for (std::size_t i = 0; i < payload_bytes; ++i)
    out.push_back(static_cast<std::uint8_t>(seed * 31 + i * 7));
  return out;
}

Bytes frame_of(const Lab& lab, std::uint32_t number) {
  std::size_t size = 40;
  for (const Tlv& t : lab.tlvs) size += 8 + t.bytes;
  size = (size + lab.unit - 1) / lab.unit * lab.unit;
  Bytes out = frame({lab.version, static_cast<std::uint32_t>(size), lab.platform, number,
                     number * 20'000'000, 0, static_cast<std::uint32_t>(lab.tlvs.size()), 0});
  for (const Tlv& t : lab.tlvs) {
    const Bytes tlv = frame({t.type, static_cast<std::uint32_t>(t.bytes)}, t.bytes, number);
    out.insert(out.end(), tlv.begin() + 8, tlv.end());  // a TLV has no magic word
  }
  out.resize(size, 0x55);
  return out;
}

// Returns a frame in the format of the newer people-counting demos. The header has 48 bytes and
// ends with the number of TLVs (u16) and the checksum (u16).
Bytes frame_48(std::uint32_t number, std::uint32_t track_us) {
  const std::uint32_t size = 48 + 8 + 84, checksum = 0xbeef + number;
  return frame({0x03050004, size, 0xa6843, number, 0, 9000, 80'000, track_us, 3000,
                1 | checksum << 16, 1020, 84},
               84, number);
}

// Returns a frame in the format of the older people-counting demos. The header has 52 bytes. The
// platform and the time precede the length. The TLV length includes the TLV header.
Bytes frame_52(std::uint32_t number) {
  const std::uint32_t size = 52 + 8 + 40, checksum = 0x1234 + number;
  return frame({0x01000005, 0xa1642, number * 10'000'000, size, number, 0, 9000, 80'000, 500, 3000,
                1 | checksum << 16, 7, 48},
               40, number);
}

const Lab demo{.tlvs = {{1, 0}, {2, 512}, {6, 24}, {9, 28}}};
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
    REQUIRE(parse_frames(bytes, [=] { return piece; }).line() == whole.line());
  return whole;
}

Numbers from_to(std::uint32_t first, std::uint32_t last) {
  Numbers all(last + 1 - first);
  std::iota(all.begin(), all.end(), first);
  return all;
}

Bytes part(const Bytes& whole, std::size_t from, std::size_t to) {
  return {whole.begin() + static_cast<std::ptrdiff_t>(from),
          whole.begin() + static_cast<std::ptrdiff_t>(to)};
}

}  // namespace

TEST_CASE("golden radar frames are parsed") {
  const ParsedFrames p = parse_frames(join(golden()));
  REQUIRE(p.line() ==
          "bytes 352, frames 3, frame_bytes 352, range_profiles 3, other_tlvs 1, lost_frames 2, "
          "delivered: 209/8/0 210/8/0 213/8/0");
  CHECK(p.counts.last_frame_number == 213u);
  std::vector<float> profile;
  for (const int code : {5000, 6000, 65535, 0, 1, 258, 772, 4097})
    profile.push_back(power_from_code(static_cast<std::uint16_t>(code), antennas));
  CHECK(profile[0] == Approx(std::exp2(5000 / 96.)));
  CHECK(profile[2] == std::exp2(127.f));
  for (const RadarFrame& f : p.frames) CHECK(f.power == profile);
  CHECK(p.frames[0].time_cpu_cycles == 20'000'000);
  REQUIRE(p.frames[0].stats);
  CHECK(p.frames[0].stats->inter_frame_processing_us == 4000);
  CHECK(p.frames[0].stats->transmit_us == 8591);
  CHECK(p.frames[0].stats->inter_frame_load_percent == 2);
  CHECK_FALSE(p.frames[0].temperature);
  REQUIRE(p.frames[1].temperature);
  CHECK(p.frames[1].temperature->invalid == 0);
  CHECK(p.frames[1].temperature->time_ms == 123'456);
  CHECK(p.frames[1].temperature->celsius[7] == -3);
  CHECK(p.frames[2].lost_before == 2);
  CHECK_FALSE(p.frames[2].stats);
}

TEST_CASE("golden radar heat maps are parsed") {
  const ParsedFrames p = parse_frames(join(read_golden("radar_array.hex")));
  REQUIRE(p.line() ==
          "bytes 992, frames 4, frame_bytes 992, range_profiles 4, arrays 3, other_tlvs 2, "
          "delivered: 301/4/64 302/4/96 303/4/64 304/4/0");
  for (std::size_t i = 0; i < 3; ++i) {  // the first of two heat map TLVs of frame 303 is used
    CAPTURE(i);
    const std::size_t count = i == 1 ? 12 : 8;
    const std::vector<std::int16_t>& array = p.frames[i].array;
    // Each sample is stored as the imaginary part followed by the real part.
    CHECK((array[0] == -32768 && array[1] == 32767));
    CHECK(array[2 * (3 * count + 5)] == 305);
    CHECK(array[2 * (3 * count + 5) + 1] == -1305);
    CHECK(array[2 * count - 2] == static_cast<int>(count) - 1);
    CHECK(p.frames[i].planar == (i == 1));
  }
  CHECK(p.frames[0].stats);
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
  CHECK(parse_frames(join({junk, g[0], junk, g[1], junk})).line() ==
        "bytes 336, frames 2, frame_bytes 288, range_profiles 2, other_tlvs 1, junk_bytes 48, "
        "resyncs 2, delivered: 209/8/0 210/8/0");
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
  const auto [at, values, counter] =
      GENERATE(table<std::size_t, Numbers, std::uint64_t FrameCounts::*>(
          {{12, {0, 39, 63, 65'537, 0xffffffff}, &FrameCounts::bad_headers},
           {12, {60'000}, &FrameCounts::truncated_frames},
           {32, {17}, &FrameCounts::bad_headers},
           {32, {1, 0}, &FrameCounts::bad_tlvs},
           {44, {5000}, &FrameCounts::bad_tlvs}}));
  for (const std::uint32_t value : values) {
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
  if (GENERATE(false, true)) {
    parser.resolve(keep);
    CHECK_FALSE(parser.in_doubt());
    REQUIRE(frames.size() == 1);
    parser.resolve(keep);
  }
  parser.feed(golden()[2], later, keep);
  REQUIRE(frames.size() == 2);
  CHECK(frames[0].received == whole);
  CHECK(frames[1].received == later);
  CHECK(frames[0].frame_number == frames[1].frame_number);
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
  for (const auto& [lab, last] :
       {std::pair(&demo, " 30/256/0"), {&vital_signs, " 30/38/0"}, {&exact, " 30/38/0"}}) {
    const ParsedFrames s = parse(stream(30, *lab));
    CHECK(s.numbers() == from_to(1, 30));
    CHECK(s.counts.other_tlvs == 30);
    CHECK(s.counts.junk_bytes == 0);
    CHECK(s.line().ends_with(last));
  }
}

TEST_CASE("radar frames of other TI demos with the same magic word are refused one by one") {
  for (const std::uint32_t track_us : {0u, 1u, 16u, 400u, 100'000u}) {
    CAPTURE(track_us);
    const ParsedFrames s =
        parse(stream(60, [&](std::uint32_t i) { return frame_48(i, track_us); }));
    CHECK(s.numbers().empty());
    CHECK(s.counts.bad_headers + s.counts.bad_tlvs == 60);
  }
  CHECK(parse(stream(60, frame_52)).line() ==
        "bytes 6000, junk_bytes 6000, bad_headers 60, delivered:");
  const ParsedFrames mixed = parse(stream(60, [](std::uint32_t i) {
    return i % 3 == 0 ? frame_48(i, 300) : i % 3 == 1 ? frame_52(i) : frame_of(demo, i);
  }));
  CHECK(mixed.counts.frames == 20);
  CHECK(mixed.line().ends_with(" 59/256/0"));
}

TEST_CASE("a header inside a radar frame starts a frame if its version and platform are the same") {
  Lab inner = exact;
  const int other = GENERATE(0, 1, 2);
  if (other == 1) ++inner.version;
  if (other == 2) ++inner.platform;
  Bytes outer = frame_of(demo, 5);
  const Bytes whole = frame_of(inner, 6);
  std::ranges::copy(whole, outer.begin() + 100);
  CHECK(parse(join({outer, frame_of(demo, 7)})).numbers() ==
        (other ? Numbers{5, 7} : Numbers{6, 7}));
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
  Numbers lost;
  const auto add = [&](const RadarFrame& f) { lost.push_back(f.lost_before); };
  for (const std::uint32_t n : {7u, 8u, 500u, 503u, 504u}) {
    parser.feed(frame_of(exact, n), HostTime{}, add);
    if (n != 500) continue;
    parser.feed(part(frame_of(exact, n), 0, 60), HostTime{}, add);  // a truncated frame
    parser.finish(add);
  }
  CHECK(parser.counts().truncated_frames == 1);
  CHECK(parser.counts().resyncs == 0);
  CHECK(lost == Numbers{0, 0, 0, 491 + 2, 0});
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
