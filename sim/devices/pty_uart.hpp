// SPDX-License-Identifier: MIT
// UART of a board behind a pseudo-terminal. A pty knows no speed and loses nothing; a UART sends at
// its rate, and loses what the host does not fetch. It is internal to the simulated radar.
#pragma once
#include <array>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <string>

#include "drivers/core/random.hpp"
#include "sim/devices/uart.hpp"

namespace echofuse::sim {

class PtyUart final : public Uart {
 public:
  // Opens a pty and points the symbolic link at it (replacing a former one). Throws Error(failed).
  PtyUart(port::SystemLoop& loop, std::string link, unsigned baud, Receive receive);
  ~PtyUart() override;

  void close() override;
  // Takes the port away, or makes a new one behind the same link. What is sent meanwhile is lost.
  void plug(bool in);

 private:
  void open();
  void read();
  std::size_t deliver(Bytes chunk) override;
  bool host_listens_at_our_rate() const;

  std::string link_;
  Receive receive_;
  boost::asio::posix::stream_descriptor master_;
  int slave_ = -1;  // kept open: with no slave the master reports EIO
  std::array<std::uint8_t, 512> in_{};
  Rng noise_;
};

}  // namespace echofuse::sim
