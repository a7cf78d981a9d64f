// SPDX-License-Identifier: MIT
#include "drivers/core/bytes.hpp"

#include "../catch.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/random.hpp"
#include "drivers/util/console.hpp"

TEST_CASE("ByteReader returns the written values, and zeros after a failed read") {
  Bytes bytes;
  put(bytes, std::uint16_t{0x0201});
  put(bytes, std::int64_t{-5});
  put(bytes, std::uint8_t{7});
  CHECK(bytes[0] == 0x01);
  ByteReader in(bytes);
  CHECK(in.get<std::uint16_t>() == 0x0201);
  CHECK(in.get<std::int64_t>() == -5);
  CHECK(in.ok());
  CHECK(in.get<std::uint32_t>() == 0);
  CHECK(in.get<std::uint8_t>() == 0);
  CHECK_FALSE(in.ok());
  CHECK(to_values<std::uint16_t>(Bytes{1, 2, 3}) == std::vector<std::uint16_t>{0x0201});
}

TEST_CASE("two axes are equal if they differ by less than a thousandth of a bin") {
  const auto same = [](double start, double step, double scale) {
    return same_axis(Axis{"spd", "counts", "ps", 336, 13343, 100, 1},
                     Axis{"spd", "counts", "ps", 336, start, step, scale});
  };
  CHECK(same(13343.05, 100, 1));
  CHECK_FALSE(same(13343.15, 100, 1));
  CHECK_FALSE(same(13343, 100.001, 1));  // shifts the last bin by 0.335 ps; the limit is 0.1 ps
  CHECK_FALSE(same(13343, 100, 8));
}

TEST_CASE("a random number stream depends only on its seed and its stream number") {
  CHECK(make_rng(1, 2)() == make_rng(1, 2)());
  CHECK(make_rng(1, 2)() != make_rng(2, 1)());
  CHECK(make_rng(1, 2)() != make_rng(1, 3)());
}

TEST_CASE("times are formatted as ISO 8601, and durations in readable units") {
  CHECK(iso8601(std::chrono::milliseconds(1'707'309'296'789)) == "2024-02-07T12:34:56.789Z");
  CHECK(iso8601(UtcTime::min()) == "1677-09-21T00:12:43.145Z");
  CHECK(iso8601(UtcTime::max()) == "2262-04-11T23:47:16.854Z");
  CHECK(human_duration(7.26) == "7.3 s");
  CHECK(human_duration(75.3) == "1 min 15 s");
  CHECK(human_duration(12'000) == "3 h 20 min");
}
