// SPDX-License-Identifier: MIT
// Tests how a byte stream is divided into bridge blocks. The blocks before a corrupted part are
// delivered, and the corruption is reported.
#include "../catch.hpp"
#include "blocks.hpp"

using namespace echofuse::bridge;
using test::join;
using test::tags_block;

namespace {

struct Received {
  BlockKind kind;
  std::uint32_t sequence;
  std::uint64_t dropped, lost;
  Bytes payload;
  bool operator==(const Received&) const = default;
};

// Feeds `bytes` to the parser in pieces. `piece` returns the size of the next piece.
template <class Piece>
std::vector<Received> feed(BlockParser& parser, ByteView bytes, Piece piece) {
  std::vector<Received> all;
  const auto keep = [&](const Block& b) {
    const Bytes payload(b.payload.begin(), b.payload.end());
    all.push_back({b.kind, b.sequence, b.dropped_items, b.lost_blocks, payload});
  };
  while (!bytes.empty()) {
    const std::size_t n = std::min<std::size_t>(bytes.size(), piece());
    parser.feed(bytes.first(n), keep);
    bytes = bytes.subspan(n);
  }
  return all;
}

std::vector<Received> feed(BlockParser& parser, ByteView bytes) {
  return feed(parser, bytes, [&] { return bytes.size(); });
}

// Feeds `bytes` in two pieces.
std::vector<Received> feed_split(BlockParser& parser, ByteView bytes, std::size_t cut) {
  return feed(parser, bytes, [&] { return std::exchange(cut, bytes.size()); });
}

// Number of the last block, and number of the block with a fault.
constexpr std::uint32_t last = 40, hit = 20;

// Returns a hello block followed by the data blocks 1 to `last`.
std::vector<Bytes> sound_stream() {
  std::vector<Bytes> stream = {test::hello_block()};
  for (std::uint32_t n = 1; n <= last; ++n) stream.push_back(tags_block(n));
  return stream;
}

// Checks that the blocks before the fault are delivered without loss. If the parser waits for more
// bytes, the fault is not known yet.
void check_broken(const std::vector<Bytes>& stream, bool waits = false) {
  BlockParser parser;
  const auto received = feed(parser, join(stream));
  CHECK(received.size() == hit);
  for (const Received& block : received) CHECK(block.lost == 0);
  CHECK((parser.broken() == nullptr) == waits);
  CHECK(parser.counts().bad_headers + parser.counts().bad_crcs == !waits);
  CHECK((parser.counts().junk_bytes > 0) == !waits);
  // After a reset, the parser must work normally for the next connection.
  parser.reset();
  CHECK_FALSE(parser.broken());
  CHECK(feed(parser, join(sound_stream())).size() == last + 1);
}

}  // namespace

TEST_CASE("golden bridge blocks are parsed however the byte stream is split") {
  const auto golden = test::read_golden("bridge.hex");
  const Bytes all = join(golden);
  std::vector<Received> expected;
  for (std::uint32_t i = 0; i < 4; ++i) {
    const ByteView payload = test::payload_of(golden.at(i));
    expected.push_back({static_cast<BlockKind>(i), i, i == 2 ? 5u : 0u, 0, {}});
    expected.back().payload.assign(payload.begin(), payload.end());
  }
  for (std::size_t cut = 1; cut <= all.size(); ++cut) {
    BlockParser parser;
    CHECK(feed_split(parser, all, cut) == expected);
  }
  BlockParser bytewise;
  CHECK(feed(bytewise, all, [] { return 1; }) == expected);
  CHECK(bytewise.counts().bytes == all.size());
  CHECK(bytewise.counts().blocks == 4);
  CHECK(bytewise.counts().junk_bytes + bytewise.counts().gaps == 0);
}

TEST_CASE("each flipped bit in a bridge block is detected, and no later block is accepted") {
  const std::size_t size = tags_block(hit).size();
  for (std::size_t bit = 0; bit < 8 * size; ++bit) {
    CAPTURE(bit);
    auto stream = sound_stream();
    stream[hit][bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
    const auto length = ByteReader(ByteView(stream[hit]).subspan(12)).get<std::uint32_t>();
    // If the flipped bit is in the length, the parser may wait for the rest of the block.
    check_broken(stream,
                 length <= max_payload_bytes && header_bytes + length > (last + 1 - hit) * size);
  }
}

TEST_CASE("a bridge block truncated at any byte is detected") {
  for (std::size_t size = 1; size < tags_block(hit).size(); ++size) {
    CAPTURE(size);
    auto stream = sound_stream();
    stream[hit].resize(size);
    // More than 64 KiB must follow, because a block that is truncated after 8 bytes appears to be
    // 64 KiB long.
    stream.emplace_back(70'000);
    check_broken(stream);
  }
}

TEST_CASE("a wrong field of a bridge header is refused before the payload is received") {
  constexpr std::uint32_t data = 16 << 20, hello = 64 << 10;
  constexpr std::uint64_t items = std::uint64_t{1} << 40;
  const auto fault = [](std::uint16_t version, std::uint16_t kind, std::uint32_t payload_bytes,
                        std::uint64_t dropped, std::uint32_t reserved) -> std::string {
    Bytes header{'E', 'F', 'B', 'R'};
    put(header, version), put(header, kind), put(header, std::uint32_t{0});
    put(header, payload_bytes), put(header, dropped), put(header, reserved);
    put(header, std::uint32_t{0});
    BlockParser parser;
    CHECK(feed(parser, header).empty());
    CHECK(parser.counts().bad_headers == (parser.broken() != nullptr));
    CHECK(parser.counts().junk_bytes == (parser.broken() ? header_bytes : 0));
    return parser.broken() ? parser.broken() : "";
  };
  CHECK(fault(1, 0, hello, items, 0).empty());
  CHECK(fault(1, 5, data, items, 0).empty());
  const std::string wrong = "wrong block header: ";
  CHECK(fault(0, 1, 0, 0, 0) == wrong + "the protocol version is not 1");
  CHECK(fault(0x101, 1, 0, 0, 0) == wrong + "the protocol version is not 1");
  CHECK(fault(1, 6, 0, 0, 0) == wrong + "the block kind is not 0 to 5");
  CHECK(fault(1, 0, hello + 1, 0, 0) == wrong + "the payload exceeds 16 MiB (hello: 64 KiB)");
  CHECK(fault(1, 1, data + 1, 0, 0) == wrong + "the payload exceeds 16 MiB (hello: 64 KiB)");
  CHECK(fault(1, 1, 0, items + 1, 0) == wrong + "more than 2^40 dropped items");
  CHECK(fault(1, 1, 0, 0, 1) == wrong + "the reserved field is not 0");
}

TEST_CASE("a wrong magic word in a block is detected however the byte stream is split") {
  for (const std::string end : {"X", "EX", "EFX", "EFBX", "EFB", "EFBR", "EFBRXX"}) {
    const Bytes bytes = join({tags_block(0), Bytes(end.begin(), end.end())});
    const std::size_t wrong = end.find('X') + 1;  // number of bytes up to the first wrong one
    for (std::size_t cut = 1; cut <= bytes.size(); ++cut) {
      BlockParser parser;
      feed_split(parser, bytes, cut);
      CAPTURE(end, cut);
      CHECK(static_cast<bool>(parser.broken()) == (wrong >= 1 && wrong <= 4));
      CHECK(parser.counts().bad_headers == (wrong >= 1 && wrong <= 4));
      CHECK(parser.counts().junk_bytes == (parser.broken() ? wrong : 0));
    }
  }
}

TEST_CASE(
    "bridge block numbers may wrap, and a restart of the numbering counts as one lost block") {
  BlockParser parser;
  std::vector<std::uint64_t> lost;
  for (const std::uint32_t number : {0xffffffffu, 0u, 107u, 3u, 0x80000003u, 4u})
    lost.push_back(feed(parser, tags_block(number)).at(0).lost);
  CHECK(lost == std::vector<std::uint64_t>{1, 0, 106, 1, 0x7fffffff, 1});
  CHECK(parser.counts().gaps == 5);
  CHECK(parser.counts().lost_blocks == 109 + std::uint64_t{0x7fffffff});
}

TEST_CASE("in a recording, damaged bridge blocks are skipped and counted as lost") {
  const std::size_t at = GENERATE(0, 4, 8, 12, 13, 14, 15, 28, 40), piece = GENERATE(1, 50, 10'000);
  CAPTURE(at, piece);
  std::vector<Bytes> stream;
  for (std::uint32_t n = 0; n <= 6; ++n) stream.push_back(tags_block(n, 5));
  const std::size_t size = stream[0].size();
  stream[1][at] ^= 4;
  stream[3].erase(stream[3].end() - 7);
  BlockParser parser;
  parser.reset(true);
  std::vector<std::uint32_t> numbers;
  std::uint64_t lost = 0;
  for (const Received& block : feed(parser, join(stream), [&] { return piece; }))
    numbers.push_back(block.sequence), lost += block.lost;
  CHECK(numbers == std::vector<std::uint32_t>{0, 2, 4, 5, 6});
  CHECK(lost == 2);
  CHECK_FALSE(parser.broken());
  CHECK(parser.counts().bytes == 7 * size - 1);
  CHECK(parser.counts().junk_bytes == 2 * size - 1);
}

TEST_CASE("in a recording, the time to parse a block is proportional to its size") {
  constexpr std::size_t block_bytes = 4 << 20;  // takes hours if each byte is compared twice
  BlockParser parser;
  parser.reset(true);
  const Bytes block = make_block(BlockKind::tags, 0, 0, Bytes(block_bytes, std::uint8_t{'E'}));
  CHECK(feed(parser, block, [] { return 4096u; }).size() == 1);
  CHECK(parser.counts().junk_bytes == 0);
}

TEST_CASE("magic bytes inside a payload do not start a bridge block") {
  BlockParser parser;
  const Bytes evil = make_block(BlockKind::tags, 0, 0, tags_block(9, 0));
  CHECK(feed(parser, join({evil, tags_block(1)})).size() == 2);
}

TEST_CASE("the buffer of a large bridge block is reused for the next block") {
  const Bytes large = tags_block(0, 1 << 17);  // 2 MiB of payload
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
  CHECK(parser.counts().junk_bytes == 100);
  CHECK(parser.kept_bytes() == 0);
  feed_one();
  parser.give_back();
  CHECK(parser.kept_bytes() == 0);
}
