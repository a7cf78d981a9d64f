// SPDX-License-Identifier: MIT
// UART of a radar board. The UART sends at its baud rate, even if the receiver does not read.
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

  // Bytes are delivered in chunks that take `chunk_time` to send.
  Uart(port::Loop& loop, unsigned baud, std::chrono::milliseconds chunk_time)
      : baud_(baud), chunk_time_(chunk_time), loop_(loop), timer_(loop) {}
  virtual ~Uart() = default;
  Uart(const Uart&) = delete;
  Uart& operator=(const Uart&) = delete;

  using OnSent = std::function<void(bool arrived)>;

  // Queues bytes for sending. Calls `sent` after the last byte, with `arrived` set to true if no
  // byte was lost.
  void send(ByteView bytes, OnSent sent = {});
  // Pauses sending if `still` is true, otherwise resumes it. Queued bytes are kept.
  void hold(bool still);
  bool idle() const { return queue_.empty(); }
  unsigned baud() const { return baud_; }
  void set_baud(unsigned baud) { baud_ = baud; }
  virtual void close() { timer_.cancel(); }

  std::uint64_t sent() const { return sent_; }
  // Returns the number of bytes lost because the buffer overflowed before the host read them.
  std::uint64_t lost() const { return lost_; }

 private:
  // Delivers bytes to the receiver. Returns the number of accepted bytes.
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
    // Positions [begin, end) of the bytes in the output stream of the UART.
    std::uint64_t begin, end;
    OnSent sent;
    bool whole = true;
  };
  std::deque<Waiting> waiting_;
  std::uint64_t sent_ = 0, lost_ = 0;
};

// Creates a UART with this baud rate. The UART calls `receive` with received bytes. A radar board
// needs one UART per port.
using MakeUart = std::function<std::unique_ptr<Uart>(unsigned baud, Uart::Receive receive)>;
struct RadarBoardOptions {
  std::uint64_t seed = 1;
  FaultPlan plan{};
  unsigned sdk = 5;           // minor version of the mmWave SDK 3.x: 5 for SDK 3.5
  std::string board = "isk";  // TI board: isk, aop or ods
  // Connects both ports if `in` is true, otherwise disconnects them. The function is called
  // repeatedly, even if nothing has changed.
  std::function<void(bool in)> plug{};
};
std::unique_ptr<Device> make_radar_board(port::Loop& loop, ScenePlayer& player,
                                         const RadarBoardOptions& options, const MakeUart& make_cli,
                                         const MakeUart& make_data);

}  // namespace echofuse::sim
