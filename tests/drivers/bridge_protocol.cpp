// SPDX-License-Identifier: MIT
// Tests the readers of the payloads of bridge blocks.
#include "../catch.hpp"
#include "blocks.hpp"
#include "drivers/core/crc32c.hpp"

using namespace echofuse::bridge;
using test::payload_of;
using test::read_golden;

namespace {

// Returns a payload in which the bytes from `at` on have been replaced by `value`.
template <class T>
Bytes with(ByteView payload, std::size_t at, T value) {
  Bytes bytes(payload.begin(), payload.end());
  std::memcpy(bytes.data() + at, &value, sizeof value);
  return bytes;
}

template <class Read>
std::string reason(const Read& read) {
  return read ? "" : read.failure().what;
}

Result<Hello> hello_of(const std::string& text) { return read_hello(test::view_of(text)); }

}  // namespace

TEST_CASE("CRC-32C matches a test vector, also if it is computed in pieces") {
  CHECK(crc32c(test::view_of("123456789")) == 0xe3069283);
  // The CRC of long inputs is computed in three parallel streams. The CRC of inputs shorter than 8
  // bytes is computed with a table.
  Bytes many(100'003);
  for (std::size_t i = 0; i < many.size(); ++i) many[i] = static_cast<std::uint8_t>(i * i >> 3);
  std::uint32_t crc = 0;
  for (std::size_t at = 0; at < many.size(); at += 7)
    crc = crc32c(ByteView(many).subspan(at, std::min<std::size_t>(7, many.size() - at)), crc);
  CHECK(crc32c(many) == crc);
}

TEST_CASE("payloads of golden bridge blocks are decoded") {
  const auto golden = read_golden("bridge.hex"), sensors = read_golden("bridge_sensors.hex");
  const auto hello = read_hello(payload_of(golden[0]));
  REQUIRE(hello);
  CHECK(hello->model + ", " + hello->serial + ", " + hello->firmware ==
        "Time Tagger Ultra, 1808000BBV, 2.10");
  CHECK(read_hello(payload_of(sensors[0]))->sends == "histograms");

  std::vector<Tag> scratch;
  const auto tags = read_tags(payload_of(golden[1]), scratch);
  REQUIRE(tags);
  REQUIRE(tags->size() == 4);
  CHECK((*tags)[1].channel == 2);
  CHECK((*tags)[1].time_ps - (*tags)[0].time_ps == 13443);
  CHECK((*tags)[2].type == TagType::missed_events);
  CHECK((*tags)[2].missed_events == 7);
  CHECK((*tags)[3].type == TagType::overflow_begin);

  constexpr std::uint64_t time_us = 123'456'789'012;
  const auto depth = read_depth(payload_of(golden[2]));
  REQUIRE(depth);
  const DepthFrame& f = depth->frame;
  CHECK(std::tuple(f.width, f.height, f.device_time_us, f.frame_number) ==
        std::tuple(3, 2, time_us, 42));
  CHECK(f.depth_mm == std::vector<std::uint16_t>{0, 1000, 2000, 3000, 4000, 65535});
  CHECK(same_axis(depth->x, Axis{"depth_x", "tangent", "1", 3, -0.5, 0.5}));
  CHECK(same_axis(depth->y, Axis{"depth_y", "tangent", "1", 2, 0.25, -0.5}));

  const auto histogram = read_histogram(payload_of(sensors[1]));
  REQUIRE(histogram);
  const HistogramFrame& h = histogram->frame;
  CHECK(h.counts == std::vector<std::uint32_t>{3, 1, 4, 0, 4'000'000'000});
  CHECK(std::tuple(h.clicks(), h.pulses, h.exposure_us, h.device_time_us) ==
        std::tuple(4'000'000'008, 5000, 50'000, time_us));
  CHECK(same_axis(histogram->axis, {"spd", "counts", "ps", 5, 13343, 92.5, 1}));

  const auto profile = read_profile(payload_of(sensors[2]));
  REQUIRE(profile);
  CHECK(profile->frame.power == std::vector<float>{1, 0, 2.5F, 1e9F});
  CHECK(profile->frame.frame_number == 42);
  CHECK(profile->frame.time_cpu_cycles == static_cast<std::uint32_t>(200 * time_us));
  CHECK(same_axis(profile->axis, {"radar", "power", "m", 4, 0.25, 0.5, 1}));
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
  const std::string half(30'000, '['),
      full = R"({"model":")" + std::string(max_hello_bytes - 12, 'A') + "\"}";
  const auto refused = [](const std::string& text, const std::string& why) {
    CAPTURE(text.substr(0, 99));
    CHECK(reason(hello_of(text)) == "the hello block is not valid: " + why);
  };
  for (const std::string& text : {half, std::string(R"({"model":)"), std::string("[1]"),
                                  std::string(R"("model")"), std::string("7"), std::string()})
    refused(text, "expected a JSON object with model, serial and firmware");
  for (const char* model : {R"(["x"])", R"({"x":"y"})", "null", "5"})
    refused(R"({"model":)" + std::string(model) + "}", "\"model\" is not a string");
  refused(full + " ", "it has more than 64 KiB");
  CHECK(hello_of(full));
  CHECK(hello_of(R"({"a":)" + half + std::string(half.size(), ']') + "}"));
  const Hello hello = *hello_of(R"({"x":{"model":"no"},"model":"yes","y":["no"],"serial":"7"})");
  CHECK(hello.model + ", " + hello.serial + ", " + hello.firmware == "yes, 7, ");
}

TEST_CASE("a depth block with an impossible size or axis is refused") {
  const auto frame = [](std::uint32_t width, std::uint32_t height) {
    return depth_payload(
        {.width = width, .height = height, .depth_mm = std::vector<std::uint16_t>(width * height)},
        tangent_axis("x", width, -0.5, 1e-3), tangent_axis("y", height, 0.5, -1e-3));
  };
  const auto sized = [&](auto width, auto height) { return !!read_depth(frame(width, height)); };
  CHECK((sized(8192u, 1u) && sized(1u, 8192u)));
  CHECK_FALSE((sized(8193u, 1u) || sized(1u, 8193u) || sized(0u, 4u) || sized(4u, 0u)));
  const Bytes good = frame(4, 4);
  CHECK_FALSE(read_depth(ByteView(good).first(good.size() - 1)));
  CHECK_FALSE(read_depth(ByteView(good).first(20)));
  CHECK_FALSE(read_depth(with(good, 0, ~std::uint64_t{0})));  // (2^32 - 1)^2 pixels
  constexpr float inf = std::numeric_limits<float>::infinity();
  for (const std::size_t axis : {20, 28}) {  // the start of each axis is followed by its step
    CAPTURE(axis);
    for (const float start : {-99.99f, 99.99f}) CHECK(read_depth(with(good, axis, start)));
    for (const float start : {-100.01f, 100.01f, std::nanf(""), -inf, 3e38f})
      CHECK_FALSE(read_depth(with(good, axis, start)));
    for (const float step : {2e-6f, -2e-6f, 24.8f, -24.8f})
      CHECK(read_depth(with(good, axis + 4, step)));
    for (const float step : {0.0f, 0.9e-6f, 1e-45f, 25.2f, -25.2f, std::nanf("")})
      CHECK_FALSE(read_depth(with(good, axis + 4, step)));
  }
}

TEST_CASE("zones in a hello block are decoded, and impossible zones are refused") {
  const auto read = [](const std::string& zones) { return hello_of("{\"zones\": " + zones + "}"); };
  CHECK(read(R"([{"x": -0.5, "y": 1, "width": 0.2, "zero_ps": -3}, {"zero_ps": 12.5}])")->zones ==
        Zones{{-0.5, 1, 0.2, -3}, {Zone{}.x, Zone{}.y, Zone{}.width, 12.5}});
  CHECK(read(R"([{"x": 0, "y": 0, "width": 1, "name": "left", "more": [{"x": 5}]}])")->zones ==
        Zones{{0, 0, 1, 0}});
  CHECK(read("[]")->zones.empty());
  std::string many = "[{}";
  for (int i = 1; i < 64; ++i) many += ", {}";
  CHECK(read(many + "]")->zones.size() == 64);
  const auto refused = [&](const std::string& why, const std::vector<std::string>& all) {
    for (const std::string& zones : all) CHECK_THAT(reason(read(zones)), Catch::Contains(why));
  };
  refused("\"zones\" is not a list of at most 64", {"3", "\"a\"", "{}", "null", many + ", {}]"});
  refused("zone 0 is not an object", {"[3]"});
  refused("zone 1 is not an object", {"[{}, []]"});
  refused("zone 0 has a \"x\" that is not a number",
          {R"([{"x": "a"}])", R"([{"x": null}])", R"([{"x": {}}])"});
  const std::string impossible = " has impossible values; expected x, y and width together";
  refused("zone 1" + impossible, {R"([{}, {"x": 0}])"});
  refused("zone 0" + impossible, {R"([{"x": 0, "y": 0, "width": 0}])"});
}

TEST_CASE("impossible histogram and range profile blocks are refused") {
  const auto golden = read_golden("bridge_sensors.hex");
  const ByteView counts = payload_of(golden[1]), power = payload_of(golden[2]);
  const std::string size = "bytes, which their header contradicts", axis = "an impossible axis";
  const auto check = [](const auto& read, const std::string& why) {
    CHECK_THAT(reason(read), Catch::Contains(why));
    CHECK(static_cast<bool>(read) == why.empty());
  };
  const auto histogram = [&](std::size_t at, auto value, const std::string& why) {
    CAPTURE(at, value);
    check(read_histogram(with(counts, at, value)), why);
  };
  check(read_histogram(counts.first(counts.size() - 1)), size);
  check(read_histogram(counts.first(43)), size);
  check(read_histogram(with(counts.first(44), 4, 0u)), size);
  histogram(4, 6u, size);
  histogram(0, std::uint64_t{1} << 32 | 5, "");  // 5 zones of 1 bin each
  histogram(0, 0u, "0 zones; expected 1 to 64");
  histogram(0, 65u, "65 zones; expected 1 to 64");
  histogram(0, 64u, size);
  histogram(16, std::uint64_t{1} << 40, "");
  histogram(16, (std::uint64_t{1} << 40) + 1, "an impossible number of laser pulses");
  for (const double start_ps : {1e12, -1e12}) histogram(24, start_ps, "");
  for (const double start_ps : {1.1e12, -1.1e12}) histogram(24, start_ps, axis);
  for (const double width_ps : {1e-3, 1e9}) histogram(32, width_ps, "");
  for (const double width_ps : {0.9e-3, 1.1e9, std::nan("")}) histogram(32, width_ps, axis);
  histogram(40, 0u, "exposure time 0");

  const auto profile = [&](std::size_t at, auto value, const std::string& why) {
    CAPTURE(at, value);
    check(read_profile(with(power, at, value)), why);
  };
  check(read_profile(power.first(power.size() - 1)), size);
  check(read_profile(with(power.first(power.size() - 4), 0, 3u)), "3 bins; expected at least 4");
  for (const float start_m : {1e4F, -1e4F}) profile(16, start_m, "");
  for (const float start_m : {1.1e4F, -1.1e4F, std::nanf("")}) profile(16, start_m, axis);
  for (const float step_m : {1e-6F, 2500.0F}) profile(20, step_m, "");
  for (const float step_m : {0.0F, 0.9e-6F, 2501.0F}) profile(20, step_m, axis);
  profile(24, -1.0F, "power below 0");
  for (const float bad : {std::nanf(""), 1e38F, -1e38F})
    profile(28, bad, "power that is not a finite number below 1e38");
}
