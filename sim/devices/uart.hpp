// SPDX-License-Identifier: MIT
// UART of a board: sends at its rate, independent of the receiver.
#pragma once
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>

#include "drivers/core/bytes.hpp"
#include "drivers/port/loop.hpp"
#include "sim/devices/device.hpp"

namespace echofuse::sim {

class Uart {
 public:
  using Receive = std::function<void(ByteView)>;

  // Sends in chunks of `chunk_time`; the receiver gets a chunk at once.
  Uart(port::Loop& loop, unsigned baud, std::chrono::milliseconds chunk_time)
      : baud_(baud), chunk_time_(chunk_time), loop_(loop), timer_(loop) {}
  virtual ~Uart() = default;
  Uart(const Uart&) = delete;
  Uart& operator=(const Uart&) = delete;

  using OnSent = std::function<void(bool arrived)>;

  // Queues the bytes; `sent` is called after the last byte.
  void send(ByteView bytes, OnSent sent = {});
  // Stops or restarts the line; queued bytes are kept.
  void hold(bool still);
  bool idle() const { return queue_.empty(); }
  unsigned baud() const { return baud_; }
  void set_baud(unsigned baud) { baud_ = baud; }
  virtual void close() { timer_.cancel(); }

  std::uint64_t sent() const { return sent_; }
  // Number of bytes lost because they were not read before the host's buffers overflowed.
  std::uint64_t lost() const { return lost_; }

 private:
  // Delivers bytes to the receiver; returns the number accepted.
  virtual std::size_t deliver(Bytes chunk) = 0;
  void begin();
  void pace();

  unsigned baud_;
  std::chrono::milliseconds chunk_time_;
  port::Loop& loop_;
  port::Timer timer_;
  std::deque<std::uint8_t> queue_;
  HostTime due_{};
  bool pacing_ = false, still_ = false;
  struct Waiting {
    std::uint64_t begin, end;  // byte positions since the start
    OnSent sent;
    bool whole = true;
  };
  std::deque<Waiting> waiting_;
  std::uint64_t sent_ = 0, lost_ = 0;
};

// Creates a UART at this rate, which calls `receive`. A radar board needs one per port.
using MakeUart = std::function<std::unique_ptr<Uart>(unsigned baud, Uart::Receive receive)>;
struct RadarBoardOptions {
  std::uint64_t seed = 1;
  FaultPlan plan{};
  unsigned sdk = 5;                     // minor version: 5 is SDK 3.5
  std::string board = "isk";            // isk, aop, ods
  std::function<void(bool in)> plug{};  // unplugs both ports or plugs them in; called repeatedly
};
std::unique_ptr<Device> make_radar_board(port::Loop& loop, ScenePlayer& player,
                                         const RadarBoardOptions& options, const MakeUart& make_cli,
                                         const MakeUart& make_data);

}  // namespace echofuse::sim
