// SPDX-License-Identifier: MIT
// What a sender that lies can cost: time in proportion to its bytes, and no memory to speak of.
#include <catch2/catch.hpp>
#include <chrono>

#include "blocks.hpp"
#include "drivers/bridge/stretch_crc.hpp"
#include "drivers/core/random.hpp"

using namespace echofuse;
using namespace echofuse::bridge;
using test::join;

namespace {

using Steady = std::chrono::steady_clock;

double since(Steady::time_point begin) {
  return std::chrono::duration<double>(Steady::now() - begin).count();
}

// Headers that claim so many bytes each, with wrong sums.
Bytes liars(std::size_t count, std::uint32_t claim) {
  Bytes all;
  for (std::uint32_t i = 0; i < count; ++i) {
    Bytes header = test::make_block(BlockKind::tags, i + 1, {});
    std::memcpy(header.data() + 12, &claim, sizeof claim);
    header[28] ^= 1;
    all.insert(all.end(), header.begin(), header.end());
  }
  return all;
}

// As a TCP port does it. Returns the longest turn in seconds.
template <class OnBlock>
double feed(BlockParser& parser, ByteView bytes, const OnBlock& on_block) {
  double longest_s = 0;
  while (!bytes.empty() || parser.behind()) {
    const auto begin = Steady::now();
    const ByteView part = bytes.first(std::min<std::size_t>(bytes.size(), 256u << 10));
    part.empty() ? parser.go_on(on_block) : parser.feed(part, on_block);
    longest_s = std::max(longest_s, since(begin));
    bytes = bytes.subspan(part.size());
  }
  return longest_s;
}

}  // namespace

TEST_CASE("a CRC goes on behind bytes that it does not read") {
  Rng rng = make_rng(1, 1);
  for (const std::size_t size : {0, 1, 7, 255, 256, 4096, 100'000}) {
    Bytes a(100), b(size);
    for (Bytes* bytes : {&a, &b})
      for (auto& byte : *bytes) byte = static_cast<std::uint8_t>(rng());
    CAPTURE(size);
    CHECK((crc32c_shift(crc32c(a), size) ^ crc32c(b)) == crc32c(b, crc32c(a)));
  }
}

TEST_CASE("stretches that overlap have the CRCs that they have alone") {
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    Rng rng = make_rng(seed, 2);
    Bytes all(20'000);
    for (auto& byte : all) byte = static_cast<std::uint8_t>(rng());
    StretchCrc stretches;
    std::size_t done = 0;
    for (std::size_t begin = rng() % 500; begin < all.size(); begin += rng() % (seed + 1) * 10) {
      const std::size_t count = rng() % (all.size() - begin + 1), before = begin - done;
      const auto start = static_cast<std::uint32_t>(rng());
      // Only what is asked for is there.
      const ByteView view = ByteView(all).subspan(done, before + count);
      CAPTURE(seed, begin, count);
      REQUIRE(stretches.of(view, done, before, count, start) ==
              crc32c(ByteView(all).subspan(begin, count), start));
      done = begin;
      if (rng() % 300 == 0) break;
    }
  }
}

TEST_CASE("headers that claim 16 MiB each cost no more than their bytes") {
  // 64 GiB of sums, if each were made by itself: 10 s with the processor's own instruction.
  Bytes stream = join({test::hello_block(), liars(4096, max_payload_bytes)});
  stream.resize(stream.size() + max_payload_bytes + 1000);
  const Bytes sound = test::tags_block(7);
  stream.insert(stream.end(), sound.begin(), sound.end());
  BlockParser parser;
  std::size_t blocks = 0;
  const auto begin = Steady::now();
  feed(parser, stream, [&](const Block&) { ++blocks; });
  CHECK(since(begin) < 3);
  CHECK(blocks == 2);
  CHECK(parser.counts().bad_crcs == 4096);
}

TEST_CASE("what one lie hid is looked at in turns") {
  // Half a million liars appear at once when the one before them is found out, with a sound block
  // behind them; its magic stands there as well as theirs.
  Bytes stream =
      join({liars(1, max_payload_bytes), liars((max_payload_bytes >> 5) - 2, 64u << 10)});
  const Bytes sound = test::tags_block(7);
  stream.insert(stream.end(), sound.begin(), sound.end());
  stream.resize(stream.size() + (96u << 10));
  BlockParser parser;
  std::vector<std::uint32_t> blocks;
  std::uint64_t bad = 0, most = 0;
  const auto note = [&](const Block& b) { blocks.push_back(b.sequence); };
  const auto turn = [&] {
    most = std::max(most, parser.counts().bad_crcs - bad);
    bad = parser.counts().bad_crcs;
  };
  parser.feed(stream, note);
  turn();
  CHECK(parser.behind());
  while (parser.behind()) {
    parser.go_on(note);
    turn();
  }
  CHECK(blocks == std::vector<std::uint32_t>{7});
  CHECK(bad == (max_payload_bytes >> 5) - 1);
  CHECK(most == 1000);
}

TEST_CASE("a hello is short, flat and text") {
  const auto refused = [](const std::string& text) { return !read_hello(test::view_of(text)); };
  const std::string half(30'000, '[');
  CHECK(refused(half));
  CHECK(refused(R"({"a":)" + half + std::string(half.size(), ']') + "}"));
  CHECK(refused(R"({"a":[[[[[[[[1]]]]]]]]})"));
  CHECK_FALSE(refused(R"({"a":[[[[[[[1]]]]]]]})"));
  std::string many = R"({"a":[0)";
  for (int i = 0; i < 1022; ++i) many += ",0";
  CHECK_FALSE(refused(many + "]}"));
  CHECK(refused(many + ",0]}"));
  CHECK(refused(R"({"model":")" + std::string(max_hello_bytes, 'A') + "\"}"));
  CHECK(refused(R"({"model":["x"]})"));
  CHECK(refused(R"({"model":{"x":"y"}})"));
  CHECK(refused(R"({"model":null})"));
  CHECK(refused(R"("model")"));
  CHECK(refused("7"));
  CHECK(refused(""));
  const auto hello =
      read_hello(test::view_of(R"({"x":{"model":"no"},"model":"yes","y":["no"],"serial":"7"})"));
  REQUIRE(hello);
  CHECK(hello->model == "yes");
  CHECK(hello->serial == "7");
  CHECK(hello->firmware.empty());
}

TEST_CASE("a hello's header that claims more than 64 KiB hides nothing") {
  Bytes liar = test::hello_block();
  liar.resize(header_bytes);
  liar[14] = 2;  // 128 KiB
  BlockParser parser;
  std::size_t blocks = 0;
  parser.feed(join({liar, test::hello_block()}), [&](const Block&) { ++blocks; });
  CHECK(blocks == 1);
  CHECK(parser.counts().bad_headers == 1);
}

TEST_CASE("sides and axes of a depth frame are those of a camera") {
  const auto frame = [](std::uint32_t width, std::uint32_t height, std::array<float, 4> axes) {
    Bytes payload;
    put(payload, width);
    put(payload, height);
    put(payload, std::uint64_t{1});
    put(payload, std::uint32_t{1});
    for (const float value : axes) put(payload, value);
    payload.resize(payload.size() + std::size_t{2} * width * height);
    return payload;
  };
  const std::array<float, 4> good = {-0.5f, 1e-4f, 0.5f, -1e-4f};
  const float inf = std::numeric_limits<float>::infinity();
  CHECK(read_depth(frame(8192, 1, good)));
  CHECK(read_depth(frame(1, 8192, good)));
  CHECK_FALSE(read_depth(frame(8193, 1, good)));
  CHECK_FALSE(read_depth(frame(1, 8193, good)));
  CHECK_FALSE(read_depth(frame(8'388'000, 1, good)));
  CHECK_FALSE(read_depth(frame(0, 4, good)));
  for (const auto& axes : std::vector<std::array<float, 4>>{{3e38f, 3e38f, 0.5f, -0.1f},
                                                            {-0.5f, 0.1f, 1.0f, 1e-45f},
                                                            {-0.5f, 0.0f, 1.0f, 0.1f},
                                                            {-0.5f, 0.1f, -inf, 0.1f},
                                                            {std::nanf(""), 0.1f, 1.0f, 0.1f},
                                                            {-0.5f, 90.0f, 1.0f, 0.1f}})
    CHECK_FALSE(read_depth(frame(4, 4, axes)));
}
