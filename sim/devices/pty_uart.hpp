// SPDX-License-Identifier: MIT
// UART of a board behind a pseudo-terminal. A pty has no rate and loses nothing; a UART sends at
// its rate and loses bytes that the host does not read. Internal to the simulated radar.
#pragma once
#include <array>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <string>

#include "drivers/core/random.hpp"
#include "sim/devices/uart.hpp"

namespace echofuse::sim {

class PtyUart final : public Uart {
 public:
  // Opens a pty and creates or replaces the symbolic link to it. Throws Error(failed).
  PtyUart(port::SystemLoop& loop, std::string link, unsigned baud, Receive receive);
  ~PtyUart() override;

  void close() override;
  // Removes the port, or creates a new one behind the same link. Bytes sent in between are lost.
  void plug(bool in);

 private:
  void open();
  void read();
  std::size_t deliver(Bytes chunk) override;
  bool host_listens_at_our_rate() const;

  std::string link_;
  Receive receive_;
  boost::asio::posix::stream_descriptor master_;
  int slave_ = -1;  // kept open, because the master reports EIO without an open slave
  std::array<std::uint8_t, 512> in_{};
  Rng noise_;
};

}  // namespace echofuse::sim
