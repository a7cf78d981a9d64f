// SPDX-License-Identifier: MIT
// Server side of the bridge protocol. Serves one client at a time: sends a greeting, then the
// blocks of a device in order. Applies the faults of the device.
#pragma once
#include <cstdint>
#include <deque>
#include <functional>
#include <string>

#include "sim/devices/fault_injector.hpp"
#include "sim/devices/listener.hpp"
#include "sim/wire/encode.hpp"

namespace echofuse::sim {

// Threading: must be used only from the thread of the event loop. The listener and the injector
// must outlive the server. The device must call poll() from the `on_poll` function of the injector.
class BlockServer {
 public:
  struct QueuedBlock {
    BlockKind kind{};
    Bytes bytes;              // payload; put() adds the block header
    std::uint64_t items = 0;  // number of tags or histograms
    // Host times of the first and last tag. In a block without tags, both times are the creation
    // time of the block.
    HostTime first{}, last{};
    // The server sets the following members.
    std::uint32_t sequence = 0;
    // Text of the log entry written after sending; a fault may change it.
    const char* what = "sent";
    HostTime due{}, begun{};
    // Index of the byte changed by a `corrupt` fault; -1: no byte is changed.
    std::int64_t damage = -1;
  };
  struct Handlers {
    port::Action connected;  // called when a client has connected, before the greeting is sent
    // Writes a log entry about a block (sent, cut, dropped) or, if `block` is null, about a
    // connection.
    std::function<void(HostTime time, const char* what, const QueuedBlock* block)> log;
  };

  BlockServer(Listener& listener, FaultInjector& injector, std::string hello,
              std::size_t queue_bytes, Handlers handlers);

  bool connected() const { return connected_; }
  // Sends the greeting again if the last greeting was sent more than 0.9 s ago.
  void greet_again();
  // Queues a block for sending. Returns false if the queue is full; the block is then lost.
  bool put(QueuedBlock block);
  void lose(std::uint64_t items) { lost_ += items; }
  void poll();
  // Sends a goodbye block to the client, then accepts no further clients.
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
