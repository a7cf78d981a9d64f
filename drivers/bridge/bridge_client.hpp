// SPDX-License-Identifier: MIT
// The connection that both bridge drivers share: connect, hello, blocks; silence, goodbye and
// errors, a damaged block among them, lead to a new connection after a pause.
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
    // connecting, streaming (its hello is known), faulted; each when it changes
    std::function<void(DeviceState, const Hello&)> state;
    // Every block but hello and bye. Each connection but the first adds one lost block: how many
    // there were is not known.
    std::function<void(const Block&, HostTime)> block;
    std::function<void(Severity, const std::string&)> event;
  };

  // `programs`: what a message about a refused connection says to start; may be empty.
  BridgeClient(port::Loop& loop, port::ByteOpener opener, std::string programs);
  void start(Handlers handlers);
  void stop();
  // Counts a delivered block of a wrong kind or payload; it is lost for the block after it.
  // `expected`: the blocks that the driver takes, "tags", "histograms", "depth frames" or "range
  // profiles".
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
  bool connected_ = false, told_kind_ = false;  // on this connection
  std::uint64_t connections_ = 0, bad_payloads_ = 0;
  std::uint64_t lost_blocks_ = 0, dropped_items_ = 0;  // not yet handed on
  std::unique_ptr<port::BytePort> port_;
};

}  // namespace echofuse::bridge
