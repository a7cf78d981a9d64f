// SPDX-License-Identifier: MIT
#pragma once
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "drivers/bridge/bridge_protocol.hpp"
#include "sim/wire/encode.hpp"
#include "wire.hpp"

namespace echofuse::test {

// Proxy between the tagger and the daemon. For some time, it refuses connections from the daemon
// and buffers the tagger's data. When the daemon connects again, it sends the buffered data first.
class Keeper {
 public:
  Keeper(port::Loop& loop, port::ByteOpener& place) : loop_(loop), down_(loop), up_(place()) {
    down_.start({.connected = [this] { begin(); }, .left = [this] { leave(); }});
    down_.accept();
    place = down_.opener();
    up_->open(
        {.opened = [] {},
         .bytes = [this](ByteView bytes) { parser_.feed(bytes, [this](auto& b) { take(b); }); },
         .gone = [](auto&) {}});
  }
  void away(bool now) {
    down_.plug(!now);
    if (!now) return;
    down_.hang_up();
    leave();
  }
  std::size_t kept = 0;  // number of buffered tag blocks

 private:
  void begin() {
    connected_ = true;
    number_ = 0;
    send(sim::BlockKind::hello, hello_);
    for (const Bytes& tags : std::exchange(waiting_, {})) send(sim::BlockKind::tags, tags);
  }
  void leave() {
    connected_ = false;
    down_.accept();
  }
  void take(const bridge::Block& block) {
    Bytes payload(block.payload.begin(), block.payload.end());
    if (block.kind == bridge::BlockKind::hello) hello_ = payload;
    if (block.kind != bridge::BlockKind::tags) return;
    if (connected_) return send(sim::BlockKind::tags, payload);
    waiting_.push_back(std::move(payload));
    ++kept;
  }
  void send(sim::BlockKind kind, const Bytes& payload) {
    sent_.push_back(sim::bridge_block(kind, number_++, 0, payload));
    down_.write(sent_.back(), [](bool) {});
  }

  port::Loop& loop_;
  MemoryListener down_;
  std::unique_ptr<port::BytePort> up_;
  bridge::BlockParser parser_;
  Bytes hello_;
  std::vector<Bytes> waiting_;
  std::deque<Bytes> sent_;
  std::uint32_t number_ = 0;
  bool connected_ = false;
};

}  // namespace echofuse::test
