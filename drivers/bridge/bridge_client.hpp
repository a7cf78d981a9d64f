// SPDX-License-Identifier: MIT
// Connection used by all bridge drivers. Connects, then reads the hello and the blocks. Reconnects
// after a pause if the bridge is silent, closes the connection, or sends a damaged block.
#pragma once
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "drivers/bridge/bridge_protocol.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/backoff.hpp"
#include "drivers/port/byte_port.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::bridge {

// Threading: call all functions from the loop's thread. Handlers may call stop(). Once stop() has
// been called, no handler is called.
class BridgeClient {
 public:
  struct Handlers {
    // Called when the state changes to connecting, streaming (a hello has been received) or
    // faulted.
    std::function<void(DeviceState, const Hello&)> state;
    // Called for every block except hello and bye. Each reconnection counts as one lost block,
    // because the actual number of lost blocks is unknown.
    std::function<void(const Block&, HostTime)> block;
    std::function<void(Severity, const std::string&)> event;
  };

  // `programs`: bridge programs that the error message suggests if the connection is refused.
  BridgeClient(port::Loop& loop, port::ByteOpener opener, std::string programs);
  void start(Handlers handlers);
  void stop();
  // Rejects a delivered block because its kind is unexpected or its payload is invalid. The block
  // is reported as lost with the next delivered block. `expected`: kind that the driver expects.
  // `reason`: fault of the payload; each reason is reported once.
  void reject(const Block& block, BlockKind expected, const std::string& reason);
  std::vector<Counter> counters() const;

 private:
  void connect();
  void on_block(Block block, HostTime received);
  void on_hello(const Block& block);
  void watch();
  void check_liveness();
  void fail(const std::string& why, Severity severity = Severity::warning);

  port::ByteOpener opener_;
  std::string programs_;
  port::Loop& loop_;
  port::Timer timer_;
  port::Backoff backoff_;
  Handlers handlers_;
  BlockParser parser_;
  Hello hello_;
  // number of blocks and number of bytes received by the time of the last liveness check
  std::uint64_t blocks_seen_ = 0, bytes_seen_ = 0;
  int quiet_checks_ = 0;
  bool running_ = false, faulted_ = false, greeted_ = false;
  bool connected_ = false,
       kind_reported_ = false;  // reset to false when a new connection is attempted
  std::uint64_t connections_ = 0, bad_payloads_ = 0;
  // losses to be reported with the next delivered block
  std::uint64_t lost_blocks_ = 0, dropped_items_ = 0;
  std::set<std::string> reasons_;  // reported reasons of rejected blocks
  std::unique_ptr<port::BytePort> port_;
};

}  // namespace echofuse::bridge
