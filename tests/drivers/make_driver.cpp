// SPDX-License-Identifier: MIT
#include "drivers/make_driver.hpp"

#include "../fixtures/error.hpp"
#include "drivers/port/loop.hpp"

using test::refusal_by;

TEST_CASE("an address for another kind of device is refused when the driver is created") {
  port::SystemLoop loop;
  const auto tdc = [&](const char* a) { return refusal_by([&] { make_tdc(loop, {a}); }); };
  const auto depth = [&](const char* a) { return refusal_by([&] { make_depth(loop, {a}); }); };
  const auto radar = [&](const char* cli, const char* data) {
    return refusal_by([&] { make_radar(loop, {cli, data, "", "x.cfg"}); });
  };
  CHECK_THAT(tdc("usb:04b4"), Catch::Contains("usb:VVVV:PPPP"));
  CHECK_THAT(tdc("serial:/dev/ttyUSB0"), Catch::Contains("expected the address of a time tagger"));
  CHECK_THAT(tdc("nonsense"), Catch::Contains("\"nonsense\": expected"));
  CHECK_THAT(depth("usb:2bc5:0670"), Catch::Contains("expected the address of a depth camera"));
  CHECK_THAT(radar("hid:10c4:ea80:A", "hid:10c4:ea80:B"), Catch::Contains("contains no command"));
  CHECK_THAT(refusal_by([&] {
               make_radar(loop, {"serial:/dev/x", "hid:10c4:ea80", "", "x.cfg", 3'000'000});
             }),
             Catch::Contains("a CP2110 supports 300 to 1000000"));
  CHECK_THAT(radar("serial:/dev/x", "bridge:tcp://a:1"),
             Catch::Contains("expected the address of a radar port"));
  RadarConfig bridge;
  bridge.address = "serial:/dev/x";
  CHECK_THAT(refusal_by([&] { make_radar(loop, bridge); }),
             Catch::Contains("expected the address of a radar: bridge:tcp:"));
  CHECK_THAT(radar("serial:/dev/x", "serial:/dev/y"),
             Catch::Contains("x.cfg: contains no command"));
}
