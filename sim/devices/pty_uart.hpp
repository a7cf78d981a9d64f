// SPDX-License-Identifier: MIT
// UART of a simulated radar board, connected to the host by a pseudo-terminal (pty). A pty has no
// baud rate and loses no data. The simulated UART sends at its baud rate, and loses bytes that the
// host does not read in time.
#pragma once
#include <array>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <string>

#include "drivers/core/random.hpp"
#include "sim/devices/uart.hpp"

namespace echofuse::sim {

class PtyUart final : public Uart {
 public:
  // Opens a pty and creates a symbolic link to the pty. An existing link is replaced. Throws
  // Error(failed) if the pty or the link cannot be created.
  PtyUart(port::SystemLoop& loop, std::string link, unsigned baud, Receive receive);
  ~PtyUart() override;

  void close() override;
  // Removes the port if `in` is false; otherwise creates a new pty with the same link. Bytes sent
  // while the port is removed are lost.
  void plug(bool in);

 private:
  void open();
  void read();
  std::size_t deliver(Bytes chunk) override;
  bool host_listens_at_our_rate() const;

  std::string link_;
  Receive receive_;
  boost::asio::posix::stream_descriptor master_;
  int slave_ = -1;  // kept open, because reads from the master fail with EIO if no slave is open
  std::array<std::uint8_t, 512> in_{};
  Rng noise_;
};

}  // namespace echofuse::sim
