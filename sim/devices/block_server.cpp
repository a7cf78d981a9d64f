// SPDX-License-Identifier: MIT
#include "sim/devices/block_server.hpp"

#include <utility>

namespace echofuse::sim {
namespace {

constexpr auto hello_pause = std::chrono::milliseconds(900);

}  // namespace

BlockServer::BlockServer(Listener& listener, FaultInjector& injector, std::string hello,
                         std::size_t queue_bytes, Handlers handlers)
    : listener_(listener),
      injector_(injector),
      hello_(std::move(hello)),
      queue_bytes_(queue_bytes),
      handlers_(std::move(handlers)) {
  listener_.start(
      {.connected = [this] { begin(); }, .left = [this] { disconnect("client left"); }});
  listener_.accept();
}

void BlockServer::begin() {
  connected_ = true;
  ++clients_;
  handlers_.log(injector_.now(), "connected", nullptr);
  sequence_ = 0;
  lost_ = 0;
  handlers_.connected();
  greet();
}

void BlockServer::greet() {
  put({.kind = BlockKind::hello,
       .bytes = Bytes(hello_.begin(), hello_.end()),
       .first = injector_.now(),
       .last = injector_.now()});
  next_hello_ = injector_.now() + hello_pause;
}

void BlockServer::greet_again() {
  if (connected_ && injector_.now() > next_hello_) greet();
}

void BlockServer::stop() {
  stopping_ = true;
  if (listener_.plugged()) listener_.plug(false);
  if (connected_)
    put({.kind = BlockKind::bye, .bytes = {}, .first = injector_.now(), .last = injector_.now()});
}

void BlockServer::disconnect(const char* why) {
  if (!connected_) return;
  connected_ = false;
  handlers_.log(injector_.now(), why, nullptr);
  listener_.hang_up();
  if (!writing_) next_client();
}

// Logs and discards the queued blocks of the last client, then accepts the next client. Must not be
// called during a write, because the write uses a buffer of the queue.
void BlockServer::next_client() {
  for (const QueuedBlock& block : queue_) log(block, block.begun == HostTime{} ? "unsent" : "cut");
  queue_.clear();
  queued_bytes_ = 0;
  if (!stopping_) listener_.accept();
}

// Starts or ends an unplug fault, and writes the next block if it is due. While the device is
// unplugged, clients cannot connect.
void BlockServer::poll() {
  if (stopping_) return;
  if (const bool in = !injector_.active(FaultKind::unplug); in != listener_.plugged()) {
    listener_.plug(in);
    if (!in) disconnect("unplugged");
  }
  if (!queue_.empty() && !writing_ && connected_) write();
}

bool BlockServer::put(QueuedBlock block) {
  if (queued_bytes_ + block.bytes.size() > queue_bytes_) return false;
  block.sequence = sequence_++;
  block.due = injector_.due();
  block.bytes =
      bridge_block(block.kind, block.sequence, std::exchange(lost_, 0), ByteView(block.bytes));
  if (injector_.triggers(FaultKind::drop)) {
    log(block, "dropped");
    return true;
  }
  if (injector_.triggers(FaultKind::corrupt)) {
    block.damage = static_cast<std::int64_t>(injector_.corrupt(block.bytes));
    block.what = "corrupt";
  }
  if (const Bytes junk = injector_.garbage(); !junk.empty()) {
    block.bytes.insert(block.bytes.begin(), junk.begin(), junk.end());
    block.what = "garbage";
  }
  queued_bytes_ += block.bytes.size();
  queue_.push_back(std::move(block));
  if (!writing_) write();
  return true;
}

void BlockServer::log(const QueuedBlock& block, const char* what) {
  handlers_.log(block.begun == HostTime{} ? injector_.now() : block.begun, what, &block);
}

// Writes the next block. Does nothing during a stall fault or if the block is not yet due; poll()
// tries again.
void BlockServer::write() {
  QueuedBlock& next = queue_.front();
  if (injector_.active(FaultKind::stall) || injector_.now() < next.due) return;
  next.begun = injector_.now();
  writing_ = true;
  listener_.write(next.bytes, [this](bool whole) {
    writing_ = false;
    written(whole);
  });
}

void BlockServer::written(bool whole) {
  if (whole) {  // all bytes were written, even if the connection was closed afterwards
    const QueuedBlock& block = queue_.front();
    log(block, block.what);
    ++blocks_;
    items_ += block.items;
    queued_bytes_ -= block.bytes.size();
    queue_.pop_front();
  }
  if (!connected_) return next_client();
  if (!whole) return disconnect("client left");
  if (!queue_.empty())
    write();
  else if (stopping_)
    disconnect("closed");
}

}  // namespace echofuse::sim
