// SPDX-License-Identifier: MIT
#include "drivers/make_driver.hpp"

#include "../fixtures/error.hpp"
#include "drivers/port/loop.hpp"

using test::refusal_by;

TEST_CASE("an address for another kind of device is refused when the driver is created") {
  port::SystemLoop loop;
  const auto tdc = [&](const char* a) { return refusal_by([&] { make_tdc(loop, {a}); }); };
  const auto radar = [&](const RadarConfig& c) { return refusal_by([&] { make_radar(loop, c); }); };
  RadarConfig bridge;
  bridge.address = "serial:/dev/x";
  const auto contains = [](const char* words) { return Catch::Contains(words); };
  CHECK_THAT(tdc("usb:04b4"), contains("usb:VVVV:PPPP"));
  CHECK_THAT(tdc("serial:/dev/ttyUSB0"), contains("expected the address of a time tagger"));
  CHECK_THAT(tdc("nonsense"), contains("\"nonsense\": expected"));
  CHECK_THAT(refusal_by([&] { make_depth(loop, {"usb:2bc5:0670"}); }),
             contains("expected the address of a depth camera"));
  CHECK_THAT(radar(bridge), contains("expected the address of a radar: bridge:tcp:"));
  CHECK_THAT(radar({"hid:10c4:ea80:A", "serial:/dev/y", "", "x.cfg"}),
             contains("x.cfg: contains no command"));
  CHECK_THAT(radar({"serial:/dev/x", "hid:10c4:ea80", "", "x.cfg", 3'000'000}),
             contains("a CP2110 supports 300 to 1000000"));
  CHECK_THAT(radar({"serial:/dev/x", "bridge:tcp://a:1", "", "x.cfg"}),
             contains("expected the address of a radar port"));
}

TEST_CASE("the counters of a new driver are zero") {
  port::SystemLoop loop;
  RadarConfig bridge;
  bridge.address = "bridge:tcp://127.0.0.1:1";
  const auto check = [](const auto& driver) {
    REQUIRE_FALSE(driver->counters().empty());
    for (const Counter& counter : driver->counters()) CHECK(counter.value == 0);
  };
  for (const char* address : {"bridge:tcp://127.0.0.1:1", "usb:04b4:00f1"})
    check(make_tdc(loop, {address}));
  check(make_depth(loop, {"bridge:tcp://127.0.0.1:1"}));
  check(make_radar(loop, bridge));
}
