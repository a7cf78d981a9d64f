// SPDX-License-Identifier: MIT
#include "tests/emulation/cp2110_chip.hpp"

#include <algorithm>

namespace echofuse::sim {
namespace {

constexpr std::uint8_t enable_id = 0x41, status_id = 0x42, purge_id = 0x43, config_id = 0x50;
constexpr std::size_t max_data = 63;

}  // namespace

bool Cp2110Chip::set_feature(ByteView report) {
  if (report.size() < 2) return false;
  switch (report[0]) {
    case enable_id:
      on_ = report[1] != 0;
      return true;
    case purge_id:
      if (report[1] & 2) fifo_.clear();
      return true;
    case config_id:
      if (report.size() < 9) return false;
      config_.assign(report.begin(), report.begin() + 9);
      return true;
    default:
      return false;
  }
}

std::optional<Bytes> Cp2110Chip::get_feature(std::uint8_t id) {
  if (id != status_id) return std::nullopt;
  const auto fill = static_cast<std::uint16_t>(fifo_.size());
  const auto low = static_cast<std::uint8_t>(fill), high = static_cast<std::uint8_t>(fill >> 8);
  const std::uint8_t errors = overrun_ ? 2 : 0;
  overrun_ = false;
  return Bytes{id, 0, 0, high, low, errors, 0};
}

bool Cp2110Chip::output(ByteView report) {
  if (report.empty() || report[0] < 1 || report[0] > max_data || report.size() <= report[0])
    return false;
  if (on_) transmit_(report.subspan(1, report[0]));
  return true;
}

std::optional<Cp2110Chip::Report> Cp2110Chip::next_input() {
  if (fifo_.empty()) return std::nullopt;
  const auto count = static_cast<std::ptrdiff_t>(std::min(fifo_.size(), max_data));
  Report report{static_cast<std::uint8_t>(count)};
  std::copy_n(fifo_.begin(), count, report.begin() + 1);
  fifo_.erase(fifo_.begin(), fifo_.begin() + count);
  return report;
}

std::size_t Cp2110Chip::receive(ByteView bytes) {
  if (!on_) return 0;
  const std::size_t fits = std::min(bytes.size(), fifo_bytes - fifo_.size());
  fifo_.insert(fifo_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(fits));
  overrun_ = overrun_ || fits < bytes.size();
  return fits;
}

}  // namespace echofuse::sim
