// SPDX-License-Identifier: MIT
// A CP2110 as its application note AN434 has it, between the reports of a host and the wires of a
// UART. Knows no time and no USB. Written apart from the product's drivers/port/cp2110.hpp.
#pragma once
#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <utility>

#include "drivers/core/bytes.hpp"

namespace echofuse::sim {

class Cp2110Chip {
 public:
  using Report = std::array<std::uint8_t, 64>;
  static constexpr std::size_t fifo_bytes = 480;

  // `transmit` gets what the host sends, while the UART is on.
  explicit Cp2110Chip(std::function<void(ByteView)> transmit) : transmit_(std::move(transmit)) {}

  // Host side. False or nothing: the request stalls.
  bool set_feature(ByteView report);
  std::optional<Bytes> get_feature(std::uint8_t id);
  bool output(ByteView report);
  // Bytes that one interrupt IN takes; nothing if there is nothing.
  std::optional<Report> next_input();

  // UART side: how many of the bytes fit. While the UART is off none do; what does not fit sets the
  // overrun flag.
  std::size_t receive(ByteView bytes);

  bool on() const { return on_; }
  std::uint32_t baud() const { return baud_; }
  const Bytes& config() const { return config_; }  // the last 0x50 report, all of it
  bool waiting() const { return !fifo_.empty(); }

 private:
  std::function<void(ByteView)> transmit_;
  std::deque<std::uint8_t> fifo_;
  Bytes config_;
  std::uint32_t baud_ = 115200;
  bool on_ = false, overrun_ = false;
};

}  // namespace echofuse::sim
