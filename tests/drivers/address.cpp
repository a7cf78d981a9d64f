// SPDX-License-Identifier: MIT
#include "drivers/port/address.hpp"

#include "../fixtures/error.hpp"
#include "drivers/port/backoff.hpp"

using namespace echofuse::port;

TEST_CASE("all kinds of device addresses are parsed") {
  CHECK(parse_address("bridge:tcp://127.0.0.1:41110") ==
        Address(BridgeAddress{"127.0.0.1", 41110}));
  CHECK(parse_address("bridge:tcp://lab-pc.local:1") == Address(BridgeAddress{"lab-pc.local", 1}));
  CHECK(parse_address("bridge:tcp://[::1]:65535") == Address(BridgeAddress{"::1", 65535}));
  CHECK(parse_address("usb:04b4:1004") == Address(UsbAddress{0x04b4, 0x1004, ""}));
  CHECK(parse_address("usb:151F:0020:A:7") == Address(UsbAddress{0x151f, 0x20, "A:7"}));
  CHECK(parse_address("hid:10c4:ea80:00A1") == Address(HidAddress{0x10c4, 0xea80, "00A1"}));
  CHECK(parse_address("serial:/dev/serial/by-id/usb-x") ==
        Address(SerialAddress{"/dev/serial/by-id/usb-x"}));
  CHECK(parse_address("openni:") == Address(OpenNiAddress{""}));
  CHECK(parse_address("example:0001") == Address(OtherAddress{"example:0001"}));
  CHECK(parse_address("openni:a/b.oni") == Address(OpenNiAddress{"a/b.oni"}));
}

TEST_CASE("the error for an invalid device address contains the address and the expected form") {
  const auto [text, expected] = GENERATE(table<std::string, std::string>({
      {"bridge:127.0.0.1:1", "bridge:tcp://HOST:PORT"},
      {"bridge:tcp://host", "port"},
      {"bridge:tcp://host:0", "port"},
      {"bridge:tcp://host:65536", "port"},
      {"bridge:tcp://host:1x", "port"},
      {"bridge:tcp://:1", "brackets"},
      {"bridge:tcp://::1:1", "brackets"},
      {"bridge:tcp://a/b:1", "brackets"},
      {"usb:04b4", "usb:VVVV:PPPP"},
      {"usb:4b4:1004", "usb:VVVV:PPPP"},
      {"usb:04b4:100g", "usb:VVVV:PPPP"},
      {"usb:04b4:1004:", "usb:VVVV:PPPP"},
      {"hid:04b4-1004", "hid:VVVV:PPPP"},
      {"serial:ttyUSB0", "absolute path"},
  }));
  CHECK_THAT(test::refusal_by([&, t = text] { parse_address(t); }),
             Catch::Contains("\"" + text + "\"") && Catch::Contains(expected));
}

TEST_CASE("the delay between connection attempts doubles up to 2 s") {
  Backoff backoff;
  std::vector<long> pauses;
  for (int i = 0; i < 7; ++i) pauses.push_back(backoff.next().count());
  CHECK(pauses == std::vector<long>{100, 200, 400, 800, 1600, 2000, 2000});
  // The delay between attempts is reset only after a connection has worked for 5 s.
  using std::chrono::seconds;
  backoff.alive(seconds(100));
  CHECK(backoff.next().count() == 2000);
  backoff.alive(seconds(200));
  backoff.alive(seconds(204));
  CHECK(backoff.next().count() == 2000);
  backoff.alive(seconds(300));
  backoff.alive(seconds(305));
  CHECK(backoff.next().count() == 100);
}

TEST_CASE("a connection failure is reported again only if its reason changes") {
  Backoff backoff;
  CHECK(backoff.is_news("gone"));
  CHECK_FALSE(backoff.is_news("gone"));
  CHECK(backoff.is_news("refused"));
  CHECK(backoff.is_news("gone"));
  backoff.alive(std::chrono::seconds(1));
  CHECK(backoff.is_news("gone"));
}
