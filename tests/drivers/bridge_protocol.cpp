// SPDX-License-Identifier: MIT

#include "../catch.hpp"
#include "blocks.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::bridge;
using test::join;
using test::read_golden;

namespace {

struct ParsedBlock {
  BlockKind kind;
  std::uint32_t sequence;
  std::uint64_t dropped;
  std::uint64_t lost;
  Bytes payload;
  bool operator==(const ParsedBlock&) const = default;
};

// Feeds `bytes` to the parser in pieces. `piece` returns the size of the next piece.
template <class Piece>
std::vector<ParsedBlock> feed(BlockParser& parser, ByteView bytes, Piece piece) {
  std::vector<ParsedBlock> parsed;
  while (!bytes.empty()) {
    const std::size_t n = std::min<std::size_t>(bytes.size(), piece());
    parser.feed(bytes.first(n), [&](const Block& b) {
      parsed.push_back({b.kind,
                        b.sequence,
                        b.dropped_items,
                        b.lost_blocks,
                        {b.payload.begin(), b.payload.end()}});
    });
    bytes = bytes.subspan(n);
  }
  return parsed;
}

std::vector<ParsedBlock> feed(BlockParser& parser, ByteView bytes) {
  return feed(parser, bytes, [&] { return bytes.size(); });
}

Bytes tag_block(std::uint32_t sequence, std::size_t tags) {
  Bytes payload;
  for (std::size_t i = 0; i < tags; ++i) put(payload, Tag{.channel = 1, .time_ps = 1000});
  return test::make_block(BlockKind::tags, sequence, payload);
}

}  // namespace

TEST_CASE("CRC-32C matches the test vectors of RFC 3720 B.4") {
  CHECK(crc32c(Bytes(32, 0x00)) == 0x8a9136aa);
  CHECK(crc32c(Bytes(32, 0xff)) == 0x62a8ab43);
  Bytes up(32), down(32);
  for (std::uint8_t i = 0; i < 32; ++i) {
    up[i] = i;
    down[i] = static_cast<std::uint8_t>(31 - i);
  }
  CHECK(crc32c(up) == 0x46dd794e);
  CHECK(crc32c(down) == 0x113fdb5c);
  CHECK(crc32c(test::view_of("123456789")) == 0xe3069283);
  CHECK(crc32c(ByteView(up).subspan(7), crc32c(ByteView(up).first(7))) == 0x46dd794e);
  // The CRC of long inputs is computed in three parallel streams. The CRC of inputs shorter than 8
  // bytes is computed with a table.
  Bytes many(100'003);
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = static_cast<std::uint8_t>(i * i >> 3);
  std::uint32_t crc = 0;
  for (std::size_t at = 0; at < many.size(); at += 7)
    crc = crc32c(ByteView(many).subspan(at, std::min<std::size_t>(7, many.size() - at)), crc);
  CHECK(crc32c(many) == crc);
}

TEST_CASE("golden bridge blocks are parsed however the byte stream is split") {
  const auto pieces = read_golden("bridge.hex");
  REQUIRE(pieces.size() == 4);
  const Bytes all = join(pieces);
  BlockParser whole;
  const auto expected = feed(whole, all);
  REQUIRE(expected.size() == 4);
  CHECK(expected[2].kind == BlockKind::depth);
  CHECK(expected[2].dropped == 5);
  CHECK(expected[3].kind == BlockKind::bye);
  for (std::size_t cut = 1; cut < all.size(); ++cut) {
    BlockParser parser;
    std::size_t next = cut;
    CHECK(feed(parser, all, [&] { return std::exchange(next, all.size()); }) == expected);
  }
  BlockParser bytewise;
  CHECK(feed(bytewise, all, [] { return 1; }) == expected);
  CHECK(bytewise.counts().bytes == all.size());
  CHECK(bytewise.counts().blocks == 4);
  CHECK(bytewise.counts().junk_bytes + bytewise.counts().gaps == 0);
}

TEST_CASE("payloads of golden bridge blocks are decoded") {
  BlockParser parser;
  const auto parsed = feed(parser, join(read_golden("bridge.hex")));
  REQUIRE(parsed.size() == 4);
  const auto hello = read_hello(parsed[0].payload);
  REQUIRE(hello);
  CHECK(hello->model == "Time Tagger Ultra");
  CHECK(hello->serial == "1808000BBV");
  CHECK(hello->firmware == "2.10");

  std::vector<Tag> scratch;
  const auto tags = read_tags(parsed[1].payload, scratch);
  REQUIRE(tags);
  REQUIRE(tags->size() == 4);
  CHECK((*tags)[1].channel == 2);
  CHECK((*tags)[1].time_ps - (*tags)[0].time_ps == 13443);
  CHECK((*tags)[2].type == TagType::missed_events);
  CHECK((*tags)[2].missed_events == 7);
  CHECK((*tags)[3].type == TagType::overflow_begin);

  const auto depth = read_depth(parsed[2].payload);
  REQUIRE(depth);
  CHECK(depth->frame.width == 3);
  CHECK(depth->frame.height == 2);
  CHECK(depth->frame.device_time_us == 123'456'789'012);
  CHECK(depth->frame.frame_number == 42);
  CHECK(depth->frame.depth_mm == std::vector<std::uint16_t>{0, 1000, 2000, 3000, 4000, 65535});
  CHECK(same_axis(depth->x, Axis{"depth_x", "tangent", "1", 3, -0.5, 0.5}));
  CHECK(same_axis(depth->y, Axis{"depth_y", "tangent", "1", 2, 0.25, -0.5}));
}

TEST_CASE("tags at an odd memory address are decoded") {
  Bytes shifted(1);
  for (int i = 0; i < 3; ++i) put(shifted, Tag{.channel = i, .time_ps = -i});
  std::vector<Tag> scratch;
  const auto tags = read_tags(ByteView(shifted).subspan(1), scratch);
  REQUIRE(tags);
  CHECK((*tags)[2].channel == 2);
  CHECK((*tags)[2].time_ps == -2);
  CHECK_FALSE(read_tags(shifted, scratch));
}

TEST_CASE("a hello block with invalid JSON, excessive length or wrong types is refused") {
  const std::string half(30'000, '[');
  for (const std::string& text :
       {half, R"({"model":")" + std::string(max_hello_bytes, 'A') + "\"}",
        std::string(R"({"model":["x"]})"), std::string(R"({"model":{"x":"y"}})"),
        std::string(R"({"model":null})"), std::string(R"({"model": 5})"),
        std::string(R"({"model":)"), std::string(R"("model")"), std::string("[1]"),
        std::string("7"), std::string()}) {
    CAPTURE(text.substr(0, 99));
    CHECK_FALSE(read_hello(test::view_of(text)));
  }
  CHECK(read_hello(test::view_of("{}")));
  CHECK(read_hello(test::view_of(R"({"a":)" + half + std::string(half.size(), ']') + "}")));
  const auto hello =
      read_hello(test::view_of(R"({"x":{"model":"no"},"model":"yes","y":["no"],"serial":"7"})"));
  REQUIRE(hello);
  CHECK(hello->model == "yes");
  CHECK(hello->serial == "7");
  CHECK(hello->firmware.empty());
}

TEST_CASE("a hello block of more than 64 KiB is refused before its payload is received") {
  Bytes block = test::hello_block();
  block.resize(header_bytes);
  block[14] = 2;  // sets the payload length to 128 KiB
  BlockParser parser;
  CHECK(feed(parser, block).empty());
  CHECK(parser.broken());
  CHECK(parser.counts().bad_headers == 1);
}

TEST_CASE("a depth block with an impossible size or axis is refused") {
  const auto frame = [](std::uint32_t width, std::uint32_t height,
                        std::array<float, 4> axes = {-0.5f, 1e-4f, 0.5f, -1e-4f}) {
    Bytes payload;
    put(payload, width), put(payload, height);
    put(payload, std::uint64_t{1}), put(payload, std::uint32_t{1});
    for (const float value : axes) put(payload, value);
    payload.resize(payload.size() + std::size_t{2} * width * height);
    return payload;
  };
  for (const auto& [width, height, good] : {std::tuple(8192u, 1u, true),
                                            {1u, 8192u, true},
                                            {8193u, 1u, false},
                                            {1u, 8193u, false},
                                            {8'388'000u, 1u, false},
                                            {0u, 4u, false}})
    CHECK(static_cast<bool>(read_depth(frame(width, height))) == good);
  const float inf = std::numeric_limits<float>::infinity();
  for (const auto& axes : std::vector<std::array<float, 4>>{{3e38f, 3e38f, 0.5f, -0.1f},
                                                            {-0.5f, 0.1f, 1.0f, 1e-45f},
                                                            {-0.5f, 0.0f, 1.0f, 0.1f},
                                                            {-0.5f, 0.1f, -inf, 0.1f},
                                                            {std::nanf(""), 0.1f, 1.0f, 0.1f},
                                                            {-0.5f, 90.0f, 1.0f, 0.1f}})
    CHECK_FALSE(read_depth(frame(4, 4, axes)));
  Bytes good = frame(3, 2);
  REQUIRE(read_depth(good));
  CHECK_FALSE(read_depth(ByteView(good).first(good.size() - 1)));
  CHECK_FALSE(read_depth(ByteView(good).first(20)));
  std::memset(good.data(), 0xff, 8);  // the image has (2^32 - 1)^2 pixels
  CHECK_FALSE(read_depth(good));
}

TEST_CASE("zones in a hello block are decoded, and impossible zones are refused") {
  const auto zones_of = [](const std::string& list) -> std::optional<Zones> {
    const auto hello = read_hello(test::view_of("{\"zones\": " + list + ", \"model\": \"m\"}"));
    if (!hello) return std::nullopt;
    CHECK(hello->model == "m");
    return hello->zones;
  };
  CHECK(zones_of(R"([{"x": -0.5, "y": 1, "width": 0.2, "zero_ps": -3}, {"zero_ps": 12.5}])") ==
        Zones{{-0.5, 1, 0.2, -3}, {Zone{}.x, Zone{}.y, Zone{}.width, 12.5}});
  CHECK(zones_of(R"([{"x": 0, "y": 0, "width": 1, "name": "left", "more": [{"x": 5}]}])") ==
        Zones{{0, 0, 1, 0}});
  CHECK(zones_of("[]") == Zones{});
  const std::string list = "\"zones\" is not a list of at most 64 zones",
                    number = "zone 0 has a \"x\" that is not a number",
                    impossible = "has impossible values; expected x, y and width together";
  for (const auto& [given, why] : {std::pair<std::string, std::string>{"3", list},
                                   {"\"a\"", list},
                                   {"{}", list},
                                   {"null", list},
                                   {"[3]", "zone 0 is not an object"},
                                   {"[{}, []]", "zone 1 is not an object"},
                                   {R"([{"x": "a"}])", number},
                                   {R"([{"x": null}])", number},
                                   {R"([{"x": {}}])", number},
                                   {R"([{}, {"x": 0}])", "zone 1 " + impossible},
                                   {R"([{"x": 0, "y": 0, "width": 0}])", "zone 0 " + impossible}}) {
    CAPTURE(given);
    const auto hello = read_hello(test::view_of("{\"zones\": " + given + "}"));
    REQUIRE_FALSE(hello);
    CHECK_THAT(hello.failure().what, Catch::Contains(why));
  }
  std::string many = "[{}";
  for (int i = 1; i < 64; ++i) many += ", {}";
  CHECK(zones_of(many + "]").value().size() == 64);
  CHECK_FALSE(zones_of(many + ", {}]"));
}

TEST_CASE("histogram and range profile blocks are decoded, and impossible ones are refused") {
  const auto pieces = read_golden("bridge_sensors.hex");
  const ByteView counts = ByteView(pieces[1]).subspan(header_bytes);
  const ByteView power = ByteView(pieces[2]).subspan(header_bytes);
  BlockParser parser;
  const auto parsed = feed(parser, join(pieces));
  REQUIRE(parsed.size() == 3);
  CHECK(read_hello(ByteView(pieces[0]).subspan(header_bytes))->sends == "histograms");

  const auto histogram = read_histogram(counts);
  REQUIRE(histogram);
  CHECK(histogram->frame.counts == std::vector<std::uint32_t>{3, 1, 4, 0, 4'000'000'000});
  CHECK(histogram->frame.clicks() == 4'000'000'008);
  CHECK(histogram->frame.pulses == 5000);
  CHECK(histogram->frame.exposure_us == 50'000);
  CHECK(histogram->frame.device_time_us == 123'456'789'012);
  CHECK(same_axis(histogram->axis, {"spd", "counts", "ps", 5, 13343, 92.5, 1}));

  const auto profile = read_profile(power);
  REQUIRE(profile);
  CHECK(profile->frame.power == std::vector<float>{1, 0, 2.5F, 1e9F});
  CHECK(profile->frame.frame_number == 42);
  CHECK(same_axis(profile->axis, {"radar", "power", "m", 4, 0.25, 0.5, 1}));

  const auto with = [](ByteView good, std::size_t at, auto value) {
    Bytes bytes(good.begin(), good.end());
    std::memcpy(bytes.data() + at, &value, sizeof value);
    return bytes;
  };
  const auto reason = [](const auto& read) { return read ? "none" : read.failure().what; };
  const std::string size = "bytes, which their header contradicts";
  CHECK_THAT(reason(read_histogram(counts.first(counts.size() - 1))), Catch::Contains(size));
  CHECK_THAT(reason(read_histogram(with(counts, 4, std::uint32_t{6}))), Catch::Contains(size));
  CHECK(reason(read_histogram(with(counts, 0, std::uint32_t{0}))) == "0 zones; expected 1 to 64");
  CHECK(reason(read_histogram(with(counts, 40, std::uint32_t{0}))) == "exposure time 0");
  // The bin width is not a number, and the first bin is at -2 s, below the limit of -1 s.
  for (const auto& bad : {with(counts, 32, std::nan("")), with(counts, 24, -2e12)})
    CHECK_THAT(reason(read_histogram(bad)), Catch::StartsWith("an impossible axis"));
  CHECK_THAT(reason(read_profile(power.first(power.size() - 1))), Catch::Contains(size));
  for (const auto& bad : {with(power, 20, 0.0F), with(power, 16, std::nanf(""))})
    CHECK_THAT(reason(read_profile(bad)), Catch::StartsWith("an impossible axis"));
  CHECK_THAT(reason(read_profile(with(power, 24, -1.0F))), Catch::StartsWith("power below 0"));
  CHECK(reason(read_profile(with(power, 28, std::nanf("")))) ==
        "power that is not a finite number below 1e38");
}

TEST_CASE(
    "bridge block numbers may wrap, and a restart of the numbering counts as one lost block") {
  BlockParser parser;
  const auto parsed =
      feed(parser,
           join({tag_block(0xffffffff, 1), tag_block(0, 1), tag_block(107, 1), tag_block(3, 1)}));
  REQUIRE(parsed.size() == 4);
  CHECK(parsed[0].lost == 1);
  CHECK(parsed[1].lost == 0);
  CHECK(parsed[2].lost == 106);
  CHECK(parsed[3].lost == 1);
  CHECK(parser.counts().gaps == 3);
  CHECK(parser.counts().lost_blocks == 108);
}

TEST_CASE("in a recording, damaged bridge blocks are skipped and counted as lost") {
  const std::size_t size = tag_block(1, 5).size(), at = GENERATE(0, 4, 8, 12, 13, 14, 15, 28, 40);
  const std::size_t piece = GENERATE(1, 50, 10'000);
  Bytes bytes = tag_block(0, 5);
  const std::size_t first = bytes.size();
  for (std::uint32_t k = 1; k <= 6; ++k) {
    const Bytes block = tag_block(k, 5);
    bytes.insert(bytes.end(), block.begin(), block.end());
  }
  bytes[first + at] ^= 4;
  bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(first + 3 * size - 7));
  BlockParser parser;
  parser.reset(true);
  std::vector<std::uint32_t> numbers;
  std::uint64_t lost = 0;
  for (const ParsedBlock& block : feed(parser, bytes, [&] { return piece; }))
    numbers.push_back(block.sequence), lost += block.lost;
  CAPTURE(at, piece);
  CHECK(numbers == std::vector<std::uint32_t>{0, 2, 4, 5, 6});
  CHECK(lost == 2);
  CHECK_FALSE(parser.broken());
  CHECK(parser.counts().bytes == bytes.size());
  CHECK(parser.counts().junk_bytes == 2 * size - 1);
}

TEST_CASE("in a recording, the time to parse a block is proportional to its size") {
  constexpr std::size_t block_bytes = 4 << 20;  // takes hours if each byte is compared twice
  const Bytes block = test::make_block(BlockKind::tags, 0, Bytes(block_bytes, std::uint8_t{'E'}));
  BlockParser parser;
  parser.reset(true);
  CHECK(feed(parser, block, [] { return 4096u; }).size() == 1);
  CHECK(parser.counts().junk_bytes == 0);
}

TEST_CASE("a wrong magic word in a block is detected however the byte stream is split") {
  for (const std::string end : {"X", "EX", "EFX", "EFBX", "EFB", "EFBR", "EFBRXX"}) {
    Bytes bytes = tag_block(0, 1);
    bytes.insert(bytes.end(), end.begin(), end.end());
    for (std::size_t cut = 1; cut <= bytes.size(); ++cut) {
      BlockParser parser;
      std::size_t next = cut;
      feed(parser, bytes, [&] { return std::exchange(next, bytes.size()); });
      CAPTURE(end, cut);
      CHECK(static_cast<bool>(parser.broken()) == (end.find('X') < 4));
      CHECK(parser.counts().bad_headers == (end.find('X') < 4));
      if (parser.broken()) CHECK(parser.counts().junk_bytes >= end.find('X') + 1);
    }
  }
}

TEST_CASE("the buffer of a large bridge block is reused for the next block") {
  const Bytes large = tag_block(0, 1 << 17);  // 2 MiB of payload
  BlockParser parser;
  std::vector<const std::uint8_t*> places;
  const auto feed_one = [&] {
    for (std::size_t at = 0; at < large.size(); at += 1 << 18)
      parser.feed(ByteView(large).subspan(at, std::min<std::size_t>(1 << 18, large.size() - at)),
                  [&](const Block& b) { places.push_back(b.payload.data()); });
  };
  for (int k = 0; k < 3; ++k) feed_one();
  REQUIRE(places.size() == 3);
  CHECK((places[1] == places[0] && places[2] == places[0]));
  CHECK(parser.kept_bytes() >= large.size());
  parser.feed(ByteView(large).first(100), [](const Block&) {});
  parser.give_back();  // give_back() has no effect while a block is incomplete
  CHECK(parser.kept_bytes() >= large.size());
  parser.reset();
  CHECK(parser.kept_bytes() == 0);
  feed_one();
  parser.give_back();
  CHECK(parser.kept_bytes() == 0);
}

TEST_CASE("magic bytes inside a payload do not start a bridge block") {
  Bytes evil = tag_block(0, 2);
  const Bytes inner = tag_block(9, 0);
  std::copy(inner.begin(), inner.end(), evil.begin() + header_bytes);
  Bytes head(evil.begin(), evil.begin() + 28);
  const std::uint32_t crc = crc32c(ByteView(evil).subspan(header_bytes), crc32c(head));
  std::memcpy(evil.data() + 28, &crc, 4);
  BlockParser parser;
  const auto parsed = feed(parser, join({evil, tag_block(1, 1)}));
  REQUIRE(parsed.size() == 2);
  CHECK(parsed[0].payload.size() == 32);
}
