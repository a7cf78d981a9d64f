// SPDX-License-Identifier: MIT
// Connection of all bridge drivers: connects, reads hello and blocks. Reconnects after a pause if
// the bridge is silent, closes, or sends a damaged block.
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/backoff.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::bridge {

// Threading: the loop's thread only. After stop() no handler is called; a handler may call stop().
class BridgeClient {
 public:
  struct Handlers {
    // called on each change: connecting, streaming (hello received), faulted
    std::function<void(DeviceState, const Hello&)> state;
    // Called for every block except hello and bye. Each reconnection adds one lost block, because
    // the actual number is unknown.
    std::function<void(const Block&, HostTime)> block;
    std::function<void(Severity, const std::string&)> event;
  };

  // `programs`: suggestion for the message about a refused connection; may be empty.
  BridgeClient(port::Loop& loop, port::ByteOpener opener, std::string programs);
  void start(Handlers handlers);
  void stop();
  // Reports a delivered block of a wrong kind or payload, and adds it to the losses of the next
  // block. `expected`: the driver's kind: "tags", "histograms", "depth frames" or "range profiles".
  void reject(const Block& block, const char* expected);
  std::vector<Counter> counters() const;

 private:
  void connect();
  void on_block(Block block, HostTime received);
  void on_hello(const Block& block);
  void watch();
  void check_liveness();
  void fail(const std::string& why);

  port::ByteOpener opener_;
  std::string programs_;
  port::Loop& loop_;
  port::Timer timer_;
  port::Backoff backoff_;
  Handlers handlers_;
  BlockParser parser_;
  Hello hello_;
  std::uint64_t blocks_seen_ = 0, bytes_seen_ = 0;  // at the last check
  int quiet_checks_ = 0;
  bool running_ = false, faulted_ = false, greeted_ = false;
  bool connected_ = false, told_kind_ = false;  // per connection
  std::uint64_t connections_ = 0, bad_payloads_ = 0;
  std::uint64_t lost_blocks_ = 0, dropped_items_ = 0;  // not yet delivered
  std::unique_ptr<port::BytePort> port_;
};

}  // namespace echofuse::bridge
