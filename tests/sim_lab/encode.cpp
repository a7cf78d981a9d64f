// SPDX-License-Identifier: MIT
// Compares encoded data with bytes that were derived by hand from the tables of the formats. The
// CRC was computed by an independent program.
#include "sim/wire/encode.hpp"

#include <complex>
#include <initializer_list>

#include "../catch.hpp"

using namespace echofuse::sim;

namespace {

Bytes bytes(std::initializer_list<int> values) {
  Bytes out;
  for (const int v : values) out.push_back(static_cast<std::uint8_t>(v));
  return out;
}

const Bytes magic = bytes({0x02, 0x01, 0x04, 0x03, 0x06, 0x05, 0x08, 0x07});

}  // namespace

TEST_CASE("encoded tags and bridge blocks have the documented bytes") {
  Bytes falling;  // the channel number of a falling edge is negative
  put_tag(falling, -1, -2);
  Bytes expected_tag = bytes({0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 0xfe});
  expected_tag.resize(16, 0xff);
  CHECK(falling == expected_tag);
  Bytes tag;
  put_tag(tag, 2, 1234567890123);
  CHECK(tag == bytes({0, 0, 0, 0, 2, 0, 0, 0, 0xcb, 0x04, 0xfb, 0x71, 0x1f, 0x01, 0, 0}));
  Bytes expected = bytes({'E', 'F', 'B', 'R', 1, 0, 1, 0, 7, 0, 0, 0, 16,   0,    0,    0,
                          5,   0,   0,   0,   0, 0, 0, 0, 0, 0, 0, 0, 0x22, 0x8d, 0x64, 0xfc});
  expected.insert(expected.end(), tag.begin(), tag.end());
  CHECK(bridge_block(BlockKind::tags, 7, 5, tag) == expected);
}

TEST_CASE("an encoded radar frame has the documented bytes") {
  Rng junk(1);
  const Bytes frame =
      radar_frame({0x01020304, 0xa0b0c0d0, 0}, {range_profile_tlv({0x1234, 7})}, junk);
  const Bytes expected =
      bytes({0x02, 0x01, 0x04, 0x03, 0x06, 0x05, 0x08, 0x07,  // magic word
             0x04, 0x00, 0x05, 0x03,                          // SDK version 3.5.0.4
             64,   0,    0,    0,     // frame length of 40 + 8 + 4 bytes, padded to 64 bytes
             0x43, 0x68, 0x0a, 0x00,  // platform 0xA6843
             0x04, 0x03, 0x02, 0x01,  // frame number
             0xd0, 0xc0, 0xb0, 0xa0,  // time in CPU cycles
             0,    0,    0,    0,     // number of objects
             1,    0,    0,    0,     // number of TLVs
             0,    0,    0,    0,     // subframe number
             2,    0,    0,    0,    4,    0,    0,    0,    0x34, 0x12, 7, 0});
  REQUIRE(frame.size() == 64);
  CHECK(std::equal(expected.begin(), expected.end(), frame.begin()));
}

TEST_CASE("an encoded radar heat map stores the imaginary part first and clips large values") {
  const std::vector<std::complex<float>> samples{{1, -2}, {40000, -40000}};
  const auto tlv = heat_map_tlv(false, samples);
  CHECK(tlv.type == 4);
  CHECK(tlv.payload == bytes({0xfe, 0xff, 1, 0, 0x00, 0x80, 0xff, 0x7f}));
  CHECK(heat_map_tlv(true, samples).type == 8);
}

TEST_CASE("encoded radar statistics and temperatures have the documented bytes") {
  CHECK(stats_tlv({1, 2, 3, 4, 5, 6}).payload ==
        bytes({1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0, 5, 0, 0, 0, 6, 0, 0, 0}));
  const RadarTlv t = temperature_tlv({0, 258, {45, -1, 0, 0, 0, 0, 0, 0, 0, 3}});
  CHECK(t.type == 9);
  CHECK(t.payload == bytes({0, 0, 0, 0, 2, 1, 0, 0, 45, 0, 0xff, 0xff, 0, 0,
                            0, 0, 0, 0, 0, 0, 0, 0, 0,  0, 0,    0,    3, 0}));
}

TEST_CASE("the padding of radar frames is random and sometimes contains a magic word") {
  Rng junk(2);
  int stale = 0, zero = 0;
  constexpr int frames = 400;
  for (int i = 0; i < frames; ++i) {
    // The frame consists of 48 bytes of data and 16 bytes of padding.
    const Bytes frame = radar_frame({}, {objects_tlv()}, junk);
    REQUIRE(frame.size() == 64);
    stale +=
        std::search(frame.begin() + 48, frame.end(), magic.begin(), magic.end()) != frame.end();
    zero += std::all_of(frame.begin() + 48, frame.end(), [](auto b) { return b == 0; });
  }
  CHECK(zero == 0);
  CHECK(std::abs(stale - frames / 4) < 5 * std::sqrt(frames * 0.25 * 0.75));
}

TEST_CASE("logarithmic range profile codes are computed from the echo magnitude") {
  // For 8 antennas with magnitudes of 2^10, the code is 256 * 8 * 10 / 8.
  CHECK(log2_q8(8 * 10, 8) == 2560);
  // For 12 antennas with magnitudes of 2^10, the code is 256 * 12 * 10 / 16.
  CHECK(log2_q8(12 * 10, 12) == 1920);
  CHECK(log2_q8(0, 12) == 0);
  CHECK(log2_q8(-5, 12) == 0);
  CHECK(log2_q8(1e6, 8) == 65535);
}
