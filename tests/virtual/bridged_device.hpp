// SPDX-License-Identifier: MIT
// Device behind a bridge, in virtual time.
#pragma once
#include <chrono>
#include <deque>

#include "bench.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::test {

// Sends `hello` when a client connects, then calls `send_next` every 50 ms.
class BridgedDevice {
 public:
  BridgedDevice(port::Loop& loop, std::string hello, std::function<void(BridgedDevice&)> send_next)
      : hello_(std::move(hello)), send_next_(std::move(send_next)), timer_(loop), listener(loop) {
    listener.start({.connected = [this] { begin(); },
                    .left =
                        [this] {
                          timer_.cancel();
                          listener.accept();
                        }});
    listener.accept();
  }

  std::uint32_t number() const { return number_; }  // number of the next block
  void lose_block() { ++number_; }
  // A damaged block has a wrong last byte.
  void send(sim::BlockKind kind, const Bytes& payload, bool damaged = false) {
    sent_.push_back(sim::bridge_block(kind, number_++, 0, payload));
    if (damaged) sent_.back().back() ^= 1;
    listener.write(sent_.back(), [](bool) {});
  }

 private:
  void begin() {
    number_ = 0;
    send(sim::BlockKind::hello, {hello_.begin(), hello_.end()});
    next();
  }
  void next() {
    send_next_(*this);
    timer_.after(std::chrono::milliseconds(50), [this] { next(); });
  }

  std::string hello_;
  std::function<void(BridgedDevice&)> send_next_;
  port::Timer timer_;
  std::deque<Bytes> sent_;
  std::uint32_t number_ = 0;

 public:
  MemoryListener listener;
};

}  // namespace echofuse::test
