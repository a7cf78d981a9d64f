// SPDX-License-Identifier: MIT
// Input: a report from the CP2110. The same bytes are also encoded as reports to the CP2110.
#include "drivers/port/cp2110.hpp"
#include "fuzz.hpp"

using namespace echofuse::port;

namespace {

void receive(ByteView report) {
  const ByteView data = cp2110::data_of(report);
  const bool is_data = report.size() > 1 && report[0] >= 1 && report[0] <= cp2110::max_data;
  require(data.empty() == !is_data, "data comes from data reports only");
  if (is_data)
    require(data.data() == report.data() + 1 &&
                data.size() == std::min<std::size_t>(report[0], report.size() - 1),
            "data has the reported length, limited to the bytes received");
  const auto status = cp2110::parse_status(report);
  require(status.has_value() == (report.size() >= 7 && report[0] == 0x42),
          "a status report is complete");
  if (status)
    require(
        status->parity_error == (report[5] % 2 == 1) && status->overrun == (report[5] / 2 % 2 == 1),
        "its errors are bits 0 and 1");
}

void send(ByteView bytes) {
  Bytes arrived;
  std::size_t reports = 0;
  for (ByteView rest = bytes; !rest.empty(); ++reports) {
    const auto report = cp2110::next_data_report(rest);
    const ByteView data = cp2110::data_of(report);
    arrived.insert(arrived.end(), data.begin(), data.end());
  }
  require(std::ranges::equal(arrived, bytes), "all sent bytes arrive");
  require(reports == (bytes.size() + 62) / 63, "the number of reports is minimal");
}

}  // namespace

void fuzz::run(ByteView input) {
  receive(input);
  send(input);
  if (input.size() < 4) return;
  const auto baud = ByteReader(input).get<std::uint32_t>();
  const auto config = cp2110::config_report(baud);
  std::uint32_t sent = 0;
  for (std::size_t i = 1; i <= 4; ++i) sent = sent << 8 | config[i];
  require(config[0] == 0x50 && sent == baud, "the baud rate is sent big-endian");
}
