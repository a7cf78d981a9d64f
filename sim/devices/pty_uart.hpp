// SPDX-License-Identifier: MIT
// One UART of a board behind a pseudo-terminal. A pty knows no speed and loses nothing; a UART
// sends at its rate, and what the host does not fetch is lost. Internal to the simulated radar.
#pragma once
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>

#include "drivers/core/bytes.hpp"
#include "drivers/core/random.hpp"

namespace echofuse::sim {

class PtyUart {
 public:
  using Receive = std::function<void(ByteView)>;
  // Opens a pty and points the symbolic link at it (replacing a former one). Throws Error(failed).
  PtyUart(boost::asio::io_context& io, std::string link, unsigned baud, Receive receive);
  ~PtyUart();
  PtyUart(const PtyUart&) = delete;
  PtyUart& operator=(const PtyUart&) = delete;

  // Queued behind what is still being sent.
  void send(ByteView bytes);
  bool idle() const { return queue_.empty(); }
  void set_baud(unsigned baud) { baud_ = baud; }
  void close();

  std::uint64_t sent() const { return sent_; }
  std::uint64_t lost() const { return lost_; }  // nobody read, for longer than the host buffers

 private:
  void read();
  void pace();
  void write(Bytes chunk);
  bool host_listens_at_our_rate() const;

  std::string link_;
  unsigned baud_;
  Receive receive_;
  boost::asio::posix::stream_descriptor master_;
  boost::asio::steady_timer timer_;
  int slave_ = -1;  // kept open: with no slave the master reports EIO
  std::array<std::uint8_t, 512> in_{};
  std::deque<std::uint8_t> queue_;
  std::chrono::steady_clock::time_point due_;
  Rng noise_;
  bool pacing_ = false;
  std::uint64_t sent_ = 0, lost_ = 0;
};

}  // namespace echofuse::sim
