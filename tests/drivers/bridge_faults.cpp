// SPDX-License-Identifier: MIT
// Tests corrupted streams of blocks. The blocks before the corrupted part are delivered, and the
// corruption is reported.
#include "../catch.hpp"
#include "blocks.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse::bridge;
using test::hello_block;
using test::join;
using test::tags_block;

namespace {

// Number of the last block, and number of the block with a fault.
constexpr std::uint32_t last = 40, hit = 20;

// Returns a hello block followed by the data blocks 1 to `last`.
std::vector<Bytes> sound_stream() {
  std::vector<Bytes> stream = {hello_block()};
  for (std::uint32_t n = 1; n <= last; ++n) stream.push_back(tags_block(n));
  return stream;
}

struct Outcome {
  std::size_t delivered = 0;
  std::uint64_t lost = 0;
  std::string broken;
  BlockCounts counts;
};

Outcome receive(const std::vector<Bytes>& stream) {
  Outcome out;
  BlockParser parser;
  const auto keep = [&](const Block& block) {
    ++out.delivered;
    out.lost += block.lost_blocks;
  };
  parser.feed(join(stream), keep);
  out.broken = parser.broken() ? parser.broken() : "";
  out.counts = parser.counts();
  // After a reset, the parser must work normally for the next connection.
  parser.reset();
  CHECK_FALSE(parser.broken());
  const std::size_t before = out.delivered;
  parser.feed(join(sound_stream()), keep);
  CHECK(out.delivered - before == last + 1);
  out.delivered = before;
  return out;
}

void check_broken(const std::vector<Bytes>& stream) {
  const Outcome out = receive(stream);
  CHECK(out.delivered == hit);
  CHECK(out.lost == 0);
  CHECK_FALSE(out.broken.empty());
  CHECK(out.counts.bad_headers + out.counts.bad_crcs == 1);
  CHECK(out.counts.junk_bytes > 0);
}

}  // namespace

TEST_CASE("each flipped bit in a bridge block is detected, and no later block is accepted") {
  const std::size_t bits = 8 * tags_block(hit).size();
  for (std::size_t bit = 0; bit < bits; ++bit) {
    CAPTURE(bit);
    auto stream = sound_stream();
    stream[hit][bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
    const auto length = ByteReader(ByteView(stream[hit]).subspan(12)).get<std::uint32_t>();
    if (length <= max_payload_bytes &&
        header_bytes + length > (last + 1 - hit) * stream[hit].size()) {
      const Outcome out = receive(stream);
      CHECK(out.delivered == hit);
      CHECK(out.broken.empty());  // the flipped bit is in the length, so the parser is still
                                  // waiting for the rest of the block
    } else {
      check_broken(stream);
    }
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

TEST_CASE("garbage between bridge blocks is detected at its first byte") {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng = make_rng(seed, 1);
    Bytes garbage(1 + rng() % 5000);
    for (auto& byte : garbage) byte = static_cast<std::uint8_t>(rng());
    if (seed % 2)
      std::copy_n(tags_block(1).begin(), std::min<std::size_t>(1 + rng() % 12, garbage.size()),
                  garbage.begin());
    auto stream = sound_stream();
    stream.insert(stream.begin() + hit, garbage);
    CAPTURE(seed);
    check_broken(stream);
  }
}

TEST_CASE("bridge blocks of wrong size, version or kind are refused even if their CRC is valid") {
  for (const auto& [at, value] : {std::pair{15, 1}, {15, 255}, {4, 2}, {5, 1}, {6, 6}, {24, 1}}) {
    Bytes bad = tags_block(hit);
    bad[static_cast<std::size_t>(at)] = static_cast<std::uint8_t>(value);
    const std::uint32_t sum =
        crc32c(ByteView(bad).subspan(header_bytes), crc32c(ByteView(bad).first(28)));
    std::memcpy(bad.data() + 28, &sum, 4);
    auto stream = sound_stream();
    stream[hit] = bad;
    CAPTURE(at, value);
    check_broken(stream);
    CHECK(receive(stream).counts.bad_headers == 1);
    CHECK(receive(stream).counts.junk_bytes == header_bytes);
  }
}
