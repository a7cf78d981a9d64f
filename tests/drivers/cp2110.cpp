// SPDX-License-Identifier: MIT
// Tests CP2110 reports. The expected bytes are from AN434, libsigrok and pyserial.
#include "drivers/port/cp2110.hpp"

#include "../catch.hpp"
#include "drivers/port/open_port.hpp"
#include "drivers/util/exit_code.hpp"

using namespace echofuse::port;

TEST_CASE("the UART configuration report of the CP2110 has a big-endian baud rate") {
  CHECK(cp2110::config_report(115200) ==
        std::array<std::uint8_t, 9>{0x50, 0x00, 0x01, 0xC2, 0x00, 0, 0, 3, 0});
  CHECK(cp2110::config_report(921600) ==
        std::array<std::uint8_t, 9>{0x50, 0x00, 0x0E, 0x10, 0x00, 0, 0, 3, 0});
}

TEST_CASE("CP2110 status reports are parsed, and other bytes are refused") {
  const Bytes quiet{0x42, 0, 0, 1, 0x20, 0, 0}, both{0x42, 0, 0, 0, 0, 3, 0};
  CHECK_FALSE(cp2110::parse_status(quiet)->overrun);
  CHECK_FALSE(cp2110::parse_status(quiet)->parity_error);
  CHECK(cp2110::parse_status(both)->overrun);
  CHECK(cp2110::parse_status(both)->parity_error);
  CHECK(cp2110::parse_status(Bytes{0x42, 0, 0, 0, 0, 2, 0})->overrun);
  CHECK_FALSE(cp2110::parse_status(ByteView(both).first(6)));
  CHECK_FALSE(cp2110::parse_status(Bytes{0x41, 0, 0, 0, 0, 3, 0}));
  CHECK_FALSE(cp2110::parse_status({}));
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

TEST_CASE("a long write is split into several CP2110 reports") {
  Bytes bytes(130);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i);
  Bytes joined;
  std::vector<int> counts;
  for (ByteView rest = bytes; !rest.empty();) {
    const auto report = cp2110::next_data_report(rest);
    counts.push_back(report[0]);
    const ByteView data = cp2110::data_of(report);
    joined.insert(joined.end(), data.begin(), data.end());
  }
  CHECK(counts == std::vector<int>{63, 63, 4});
  CHECK(joined == bytes);
}

TEST_CASE("baud rates that the CP2110 does not support are refused") {
  CHECK_NOTHROW(check_hid_baud({0x10c4, 0xea80, ""}, 300));
  CHECK_NOTHROW(check_hid_baud({0x10c4, 0xea80, ""}, 1'000'000));
  CHECK_THROWS_AS(check_hid_baud({0x10c4, 0xea80, ""}, 299), Error);
  CHECK_THROWS_WITH(check_hid_baud({0x10c4, 0xea80, "A"}, 1'000'001),
                    "hid:10c4:ea80:A: 1000001 baud (a CP2110 supports 300 to 1000000 baud)");
}
