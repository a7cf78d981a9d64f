// SPDX-License-Identifier: MIT
// Model of the CP2110 according to application note AN434, between the host's reports and the UART
// lines. Answers only the requests for the status. Does not model time or USB. Does not use the
// product's drivers/port/cp2110.hpp.
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

  // `transmit` is called with the bytes that the host sends while the UART is on.
  explicit Cp2110Chip(std::function<void(ByteView)> transmit) : transmit_(std::move(transmit)) {}

  // Functions of the host side. A return value of false or nullopt means that the chip stalls the
  // request.
  bool set_feature(ByteView report);
  std::optional<Bytes> get_feature(std::uint8_t id);
  bool output(ByteView report);
  // Returns the data of one interrupt IN transfer, or nullopt if no data are waiting.
  std::optional<Report> next_input();

  // Function of the UART side. Returns the number of bytes accepted, which is 0 while the UART is
  // off. Rejecting bytes sets the overrun flag.
  std::size_t receive(ByteView bytes);

  bool on() const { return on_; }
  const Bytes& config() const { return config_; }  // last complete report 0x50 from the host
  bool waiting() const { return !fifo_.empty(); }

 private:
  std::function<void(ByteView)> transmit_;
  std::deque<std::uint8_t> fifo_;
  Bytes config_;
  bool on_ = false, overrun_ = false;
};

}  // namespace echofuse::sim
