// SPDX-License-Identifier: MIT
#include "../fixtures/error.hpp"
#include "drivers/port/backoff.hpp"
#include "drivers/port/cp2110.hpp"
#include "drivers/port/open_port.hpp"

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
  const auto refused = [](const std::string& expected, const std::vector<std::string>& texts) {
    for (const std::string& text : texts)
      CHECK_THAT(test::refusal_by([&] { parse_address(text); }),
                 Catch::Contains("\"" + text + "\"") && Catch::Contains(expected));
  };
  refused("bridge:tcp://HOST:PORT", {"bridge:127.0.0.1:1"});
  refused("port", {"bridge:tcp://host", "bridge:tcp://host:0", "bridge:tcp://host:65536",
                   "bridge:tcp://host:1x", "bridge:tcp://host:"});
  refused("brackets", {"bridge:tcp://:1", "bridge:tcp://::1:1", "bridge:tcp://a/b:1"});
  refused("usb:VVVV:PPPP", {"usb:04b4", "usb:4b4:1004", "usb:04b4:100g", "usb:04b4:1004:"});
  refused("hid:VVVV:PPPP", {"hid:04b4-1004"});
  refused("absolute path", {"serial:ttyUSB0"});
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

// The expected bytes are from AN434, libsigrok and pyserial. tests/hid checks the other reports.
TEST_CASE("CP2110 status reports are parsed, and other bytes are refused") {
  // The bits of the result are the parity error and the overrun.
  const auto faults = [](const Bytes& report) {
    const auto status = cp2110::parse_status(report);
    return status ? status->parity_error + 2 * status->overrun : -1;
  };
  CHECK(faults({0x42, 0, 0, 1, 0x20, 0, 0}) == 0);
  CHECK(faults({0x42, 0, 0, 0, 0, 3, 0}) == 3);
  CHECK(faults({0x42, 0, 0, 0, 0, 2, 0}) == 2);
  CHECK(faults({0x42, 0, 0, 0, 0, 3}) == -1);
  CHECK(faults({0x41, 0, 0, 0, 0, 3, 0}) == -1);
  CHECK(faults({}) == -1);
}

TEST_CASE("the data length in a CP2110 report is limited to the received bytes") {
  Bytes report(64, 7);
  const auto taken = [&](std::uint8_t count, std::size_t bytes) {
    report[0] = count;
    return cp2110::data_of(ByteView(report).first(bytes)).size();
  };
  CHECK(taken(1, 64) == 1);
  CHECK(taken(63, 64) == 63);
  CHECK(taken(63, 11) == 10);  // the report claims more bytes than were received
  CHECK(taken(5, 6) == 5);
  CHECK(taken(5, 1) == 0);
  CHECK(taken(0, 64) == 0);
  CHECK(taken(64, 64) == 0);  // a report with ID 64 is not a data report
  CHECK(taken(255, 64) == 0);
  CHECK(cp2110::data_of({}).empty());
}

TEST_CASE("baud rates that the CP2110 does not support are refused") {
  CHECK_NOTHROW(check_hid_baud({0x10c4, 0xea80, ""}, 300));
  CHECK_NOTHROW(check_hid_baud({0x10c4, 0xea80, ""}, 1'000'000));
  CHECK_THROWS_AS(check_hid_baud({0x10c4, 0xea80, ""}, 299), Error);
  CHECK_THROWS_WITH(check_hid_baud({0x10c4, 0xea80, "A"}, 1'000'001),
                    "hid:10c4:ea80:A: 1000001 baud (a CP2110 supports 300 to 1000000 baud)");
}
