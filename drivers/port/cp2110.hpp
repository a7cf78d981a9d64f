// SPDX-License-Identifier: MIT
// HID reports of a Silicon Labs CP2110 HID-to-UART bridge (application note AN434). The first byte
// is the report ID:
//
//   0x01..0x3f  data in either direction; the report ID is the number of data bytes (1..63)
//   0x41        feature: UART enable {u8 on}
//   0x42        feature: UART status {u16 TX fill, u16 RX fill, u8 errors, u8 break}; reading it
//               clears the errors: bit 0 parity, bit 1 overrun
//   0x43        feature: purge the buffers {u8 bit 0 TX, bit 1 RX}
//   0x50        feature: UART config {u32 baud, BIG-endian, u8 parity, u8 flow control,
//               u8 data bits - 5, u8 stop bits (0 means one)}
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>

#include "drivers/core/bytes.hpp"

namespace echofuse::port::cp2110 {

inline constexpr std::size_t report_bytes = 64;  // size of a full-speed interrupt packet
inline constexpr std::size_t max_data = 63;      // because the report ID is the number of bytes
inline constexpr std::uint32_t min_baud = 300, max_baud = 1'000'000;
// Data rate over full-speed USB if each 1 ms frame carries one full report.
inline constexpr std::uint32_t pipe_bytes_per_s = 1000 * max_data;

inline constexpr std::array<std::uint8_t, 2> enable_report{0x41, 1};
inline constexpr std::array<std::uint8_t, 2> purge_report{0x43, 3};
inline constexpr std::uint8_t status_id = 0x42;
inline constexpr std::size_t status_bytes = 7;

// Returns the report that configures the UART with 8N1 and no flow control.
inline std::array<std::uint8_t, 9> config_report(std::uint32_t baud) {
  const auto byte = [baud](unsigned shift) { return static_cast<std::uint8_t>(baud >> shift); };
  return {0x50, byte(24), byte(16), byte(8), byte(0), 0, 0, 3, 0};
}

struct UartStatus {
  bool parity_error, overrun;
};
// Returns nullopt if the bytes are not a complete status report.
inline std::optional<UartStatus> parse_status(ByteView report) {
  if (report.size() < status_bytes || report[0] != status_id) return std::nullopt;
  return UartStatus{(report[5] & 1) != 0, (report[5] & 2) != 0};
}

// Returns the payload of a data report from the bridge, or an empty view for other reports. The
// view never extends beyond the received bytes.
inline ByteView data_of(ByteView report) {
  if (report.empty() || report[0] < 1 || report[0] > max_data) return {};
  return report.subspan(1, std::min<std::size_t>(report[0], report.size() - 1));
}

// Removes the next bytes from `rest` and returns them as a data report, padded with zeros. `rest`
// must not be empty.
inline std::array<std::uint8_t, report_bytes> next_data_report(ByteView& rest) {
  std::array<std::uint8_t, report_bytes> report{};
  const std::size_t count = std::min(rest.size(), max_data);
  report[0] = static_cast<std::uint8_t>(count);
  std::copy_n(rest.begin(), count, report.begin() + 1);
  rest = rest.subspan(count);
  return report;
}

}  // namespace echofuse::port::cp2110
