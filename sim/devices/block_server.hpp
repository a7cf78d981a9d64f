// SPDX-License-Identifier: MIT
// Server end of the block protocol: serves one client at a time, greets it, and sends a device's
// blocks in order, with that device's faults.
#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <string>

#include "sim/devices/fault_injector.hpp"
#include "sim/devices/listener.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {

// Threading: the loop's thread. Device, injector and listener outlive the server; the device
// forwards the injector's polls to poll().
class BlockServer {
 public:
  struct QueuedBlock {
    BlockKind kind{};
    Bytes bytes;               // payload; write() adds the header
    std::uint64_t items = 0;   // number of tags, or frame number
    HostTime first{}, last{};  // host times of the first and last tag
    // Numbers that the server sets.
    std::uint32_t sequence = 0;
    const char* what = "sent";  // result of sending, unless a fault changes it
    HostTime due{}, begun{};
    std::int64_t damage = -1;  // index of the damaged byte; -1: none
  };
  struct Handlers {
    port::Action connected;  // before the client is greeted
    // Logs the fate of a block (with its numbers) or of a connection (without).
    std::function<void(HostTime time, const char* what, const QueuedBlock* block)> log;
  };

  BlockServer(Listener& listener, FaultInjector& injector, std::string hello,
              std::size_t queue_bytes, Handlers handlers);

  bool connected() const { return connected_; }
  // Greets the client again if the last block of this kind is 0.9 s old.
  void greet_again();
  // Returns false if the queue is full and the block is lost.
  bool put(QueuedBlock block);
  // Counts items lost before the next block.
  void lose(std::uint64_t items) { lost_ += items; }
  void poll();
  // Sends a goodbye to the client and accepts no other.
  void stop();

  std::uint64_t clients() const { return clients_; }
  std::uint64_t sent_blocks() const { return blocks_; }
  std::uint64_t sent_items() const { return items_; }

 private:
  void begin();
  void greet();
  void disconnect(const char* why);
  void next_client();
  void write();
  void written(bool whole);
  void log(const QueuedBlock& block, const char* what);

  Listener& listener_;
  FaultInjector& injector_;
  std::string hello_;
  std::size_t queue_bytes_, queued_bytes_ = 0;
  Handlers handlers_;
  std::deque<QueuedBlock> queue_;
  bool connected_ = false, writing_ = false, stopping_ = false;
  std::uint32_t sequence_ = 0;
  HostTime next_hello_{};
  std::uint64_t lost_ = 0, clients_ = 0, blocks_ = 0, items_ = 0;
};

}  // namespace echofuse::sim
