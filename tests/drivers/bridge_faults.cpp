// SPDX-License-Identifier: MIT
// What a damaged stream of blocks costs: never more than the damaged blocks, and every one counted.
#include <catch2/catch.hpp>

#include "blocks.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse;
using namespace echofuse::bridge;
using test::hello_block;
using test::join;
using test::tags_block;

namespace {

constexpr std::uint32_t last = 40, hit = 20;  // data blocks 1..last; the fault is at `hit`

// hello and the data blocks
std::vector<Bytes> sound_stream() {
  std::vector<Bytes> stream = {hello_block()};
  for (std::uint32_t n = 1; n <= last; ++n) stream.push_back(tags_block(n));
  return stream;
}

std::vector<std::uint32_t> all_but(std::initializer_list<std::uint32_t> missing) {
  std::vector<std::uint32_t> numbers;
  for (std::uint32_t n = 0; n <= last; ++n)
    if (std::find(missing.begin(), missing.end(), n) == missing.end()) numbers.push_back(n);
  return numbers;
}

struct Outcome {
  std::vector<std::uint32_t> delivered;
  std::uint64_t lost = 0, found = 0;
  BlockCounts counts;
};

// As the driver does it: what still waits when nothing more comes is given up.
Outcome receive(const std::vector<Bytes>& stream) {
  Outcome out;
  BlockParser parser;
  const auto keep = [&](const Block& block) {
    out.delivered.push_back(block.sequence);
    out.lost += block.lost_blocks;
    out.found += block.found_blocks;
  };
  parser.feed(join(stream), keep);
  parser.give_up(keep);
  out.counts = parser.counts();
  return out;
}

void check_lost(const std::vector<Bytes>& stream, std::initializer_list<std::uint32_t> damaged) {
  const Outcome out = receive(stream);
  CHECK(out.delivered == all_but(damaged));
  CHECK(out.lost == damaged.size());
  CHECK(out.counts.lost_blocks == damaged.size());
}

}  // namespace

TEST_CASE("every single flipped bit costs its block only") {
  const std::size_t bits = 8 * tags_block(hit).size();
  for (std::size_t bit = 0; bit < bits; ++bit) {
    CAPTURE(bit);
    auto stream = sound_stream();
    stream[hit][bit / 8] ^= static_cast<std::uint8_t>(1u << bit % 8);
    check_lost(stream, {hit});
  }
}

TEST_CASE("a block cut anywhere costs itself only") {
  for (std::size_t size = 0; size < tags_block(hit).size(); ++size) {
    CAPTURE(size);
    auto stream = sound_stream();
    stream[hit].resize(size);
    check_lost(stream, {hit});
  }
}

TEST_CASE("bytes missing across a border cost both blocks") {
  auto stream = sound_stream();
  stream[hit].resize(40);
  stream[hit + 1].erase(stream[hit + 1].begin(), stream[hit + 1].begin() + 8);
  check_lost(stream, {hit, hit + 1});
}

TEST_CASE("garbage between blocks costs none") {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng = make_rng(seed, 1);
    Bytes garbage(1 + rng() % 5000);
    for (auto& byte : garbage) byte = static_cast<std::uint8_t>(rng());
    if (seed % 2)  // with the beginnings of headers in it
      for (std::size_t at = 0; at + 8 < garbage.size(); at += 1 + rng() % 300)
        std::copy_n(tags_block(1).begin(), 4 + rng() % 5, garbage.begin() + static_cast<long>(at));
    auto stream = sound_stream();
    stream.insert(stream.begin() + hit, garbage);
    CAPTURE(seed);
    check_lost(stream, {});
    CHECK(receive(stream).counts.junk_bytes == garbage.size());
  }
}

TEST_CASE("a header that promises 16 MiB hides nothing for ever") {
  auto stream = sound_stream();
  Bytes liar(stream[hit].begin(), stream[hit].begin() + header_bytes);
  liar[14] = 0xff;  // length
  stream.insert(stream.begin() + hit, liar);
  check_lost(stream, {});
}

TEST_CASE(
    "oversize, another version and an unknown kind cost their block, their sum sound or not") {
  for (const auto& [at, value] : {std::pair{15, 1}, {15, 255}, {4, 2}, {5, 1}, {6, 4}, {24, 1}}) {
    Bytes bad = tags_block(hit);
    bad[static_cast<std::size_t>(at)] = static_cast<std::uint8_t>(value);
    const std::uint32_t sum =
        crc32c(ByteView(bad).subspan(header_bytes), crc32c(ByteView(bad).first(28)));
    std::memcpy(bad.data() + 28, &sum, 4);
    auto stream = sound_stream();
    stream[hit] = bad;
    CAPTURE(at, value);
    check_lost(stream, {hit});
    CHECK(receive(stream).counts.bad_headers == 1);
  }
}

TEST_CASE("blocks that come again are counted, and handed on once") {
  auto stream = sound_stream();
  const std::vector<Bytes> again(stream.begin() + hit - 9, stream.begin() + hit + 1);
  stream.insert(stream.begin() + hit + 1, again.begin(), again.end());
  check_lost(stream, {});
  CHECK(receive(stream).counts.duplicates == again.size());
}

TEST_CASE("blocks out of order are out of order, and not lost") {
  for (const std::uint32_t by : {1u, 2u, 15u}) {  // its neighbours overtake it
    auto stream = sound_stream();
    std::rotate(stream.begin() + hit, stream.begin() + hit + 1, stream.begin() + hit + 1 + by);
    const Outcome out = receive(stream);
    CAPTURE(by);
    CHECK(out.delivered.size() == last + 1);
    CHECK(out.lost == 1);
    CHECK(out.found == 1);
    CHECK(out.counts.lost_blocks == 0);
    CHECK(out.counts.out_of_order == 1);
    stream.push_back(tags_block(hit));  // once more, much later
    CHECK(receive(stream).counts.lost_blocks == 1);
  }
}

TEST_CASE("blocks that never came are counted") {
  auto stream = sound_stream();
  stream.erase(stream.begin() + hit, stream.begin() + hit + 2);
  check_lost(stream, {hit, hit + 1});
}

TEST_CASE("giving up nothing is harmless") {
  BlockParser parser;
  std::size_t blocks = 0;
  const auto count = [&](const Block&) { ++blocks; };
  parser.give_up(count);
  const Bytes block = tags_block(0);
  parser.feed(ByteView(block).first(header_bytes - 1), count);
  parser.give_up(count);  // less than a header cannot lie
  parser.feed(ByteView(block).subspan(header_bytes - 1), count);
  CHECK(blocks == 1);
  CHECK(parser.counts().junk_bytes == 0);
}
