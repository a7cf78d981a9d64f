// SPDX-License-Identifier: MIT
// Tests payloads with wrong values from a faulty sender.
#include "../catch.hpp"
#include "blocks.hpp"

using namespace echofuse;
using namespace echofuse::bridge;

TEST_CASE("a hello block with invalid JSON, excessive length or wrong types is refused") {
  const auto refused = [](const std::string& text) { return !read_hello(test::view_of(text)); };
  const std::string half(30'000, '[');
  CHECK(refused(half));
  CHECK_FALSE(refused(R"({"a":)" + half + std::string(half.size(), ']') + "}"));
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

TEST_CASE("a hello block of more than 64 KiB is refused before its payload is received") {
  Bytes block = test::hello_block();
  block.resize(header_bytes);
  block[14] = 2;  // sets the payload length to 128 KiB
  BlockParser parser;
  parser.feed(block, [](const Block&) { FAIL(); });
  CHECK(parser.broken());
  CHECK(parser.counts().bad_headers == 1);
}

TEST_CASE("a depth block with an impossible size or axis is refused") {
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
