// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_client.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

namespace echofuse::bridge {
namespace {
// A sender is silent for at most a second; a busy machine may stretch that. After two seconds
// without a block, what waits for its end is given up (8 MB/s bring 16 MiB in time), after four the
// connection.
constexpr std::chrono::seconds check_pause{1};
// The longest block, and as much again while the parser catches up.
constexpr std::size_t most_waiting_bytes = 2 * (std::size_t{max_payload_bytes} + header_bytes);
constexpr int block_timeout_checks = 2, connection_timeout_checks = 4;

}  // namespace

BridgeClient::BridgeClient(boost::asio::io_context& io, port::ByteOpener opener, const Clock& clock)
    : opener_(std::move(opener)), clock_(clock), timer_(io), turn_(io) {}

void BridgeClient::start(Handlers handlers) {
  handlers_ = std::move(handlers);
  running_ = true;
  handlers_.state(DeviceState::connecting, hello_);
  connect();
}

void BridgeClient::stop() {
  running_ = false;
  timer_.cancel();
  turn_.cancel();
  port_.reset();
}

std::vector<Counter> BridgeClient::counters() const {
  const BlockCounts& c = parser_.counts();
  return {{"bytes", c.bytes},
          {"blocks", c.blocks},
          {"junk_bytes", c.junk_bytes},
          {"bad_headers", c.bad_headers},
          {"bad_crcs", c.bad_crcs},
          {"gaps", c.gaps},
          {"lost_blocks", c.lost_blocks},
          {"out_of_order_blocks", c.out_of_order},
          {"duplicates", c.duplicates},
          {"bad_payloads", bad_payloads_},
          {"connections", connections_}};
}

void BridgeClient::connect() {
  turn_.cancel();
  turn_waits_ = false;
  parser_.reset();
  greeted_ = connected_ = told_kind_ = false;
  quiet_checks_ = 0;
  blocks_seen_ = parser_.counts().blocks;
  port_ = opener_();
  port_->open({.opened =
                   [this] {
                     ++connections_;
                     connected_ = true;
                   },
               .bytes =
                   [this](ByteView bytes) {
                     const HostTime received = clock_.now();
                     parser_.feed(bytes, [&](const Block& block) { on_block(block, received); });
                     go_on();
                   },
               .gone = [this](const Failure& failure) { fail(failure.text()); }});
  watch();
}

// With what the parser has left, after everybody else had a turn.
void BridgeClient::go_on() {
  if (!port_) return;
  if (parser_.waiting_bytes() > most_waiting_bytes)
    return fail("it sends damaged blocks faster than they can be told from sound ones");
  if (!parser_.behind() || std::exchange(turn_waits_, true)) return;
  turn_.after(std::chrono::nanoseconds(0), [this] {
    turn_waits_ = false;
    parser_.go_on([this, now = clock_.now()](const Block& block) { on_block(block, now); });
    go_on();
  });
}

void BridgeClient::watch() {
  timer_.after(check_pause, [this] { check_liveness(); });
}

// Blocks before a hello are no heartbeat.
void BridgeClient::check_liveness() {
  const bool alive =
      std::exchange(blocks_seen_, parser_.counts().blocks) != parser_.counts().blocks && greeted_;
  quiet_checks_ = alive ? 0 : quiet_checks_ + 1;
  if (quiet_checks_ == connection_timeout_checks)
    return fail(greeted_      ? "no block came for 4 s"
                : !connected_ ? "no connection within 4 s"
                              : "no hello within 4 s: is this an echofuse bridge?");
  if (quiet_checks_ == block_timeout_checks)
    parser_.give_up([this, now = clock_.now()](const Block& block) { on_block(block, now); });
  go_on();
  if (port_) watch();
}

// After stop() or a failure the parser may still have blocks in hand: they belong to no one.
void BridgeClient::on_block(Block block, HostTime received) {
  if (!running_ || !port_) return;
  // What a hello or an early block says is missing belongs to the next block that is delivered.
  lost_blocks_ += block.lost_blocks;
  found_blocks_ += block.found_blocks;
  dropped_items_ += block.dropped_items;
  const std::uint64_t both = std::min(lost_blocks_, found_blocks_);
  lost_blocks_ -= both;
  found_blocks_ -= both;
  if (block.kind == BlockKind::bye)
    return fail("the bridge said goodbye: its device is gone, or it serves another client");
  if (block.kind == BlockKind::hello) return on_hello(block);
  if (!greeted_) {
    ++lost_blocks_;
    return;
  }
  // Only now is it well: a bridge that greets and closes at once is retried ever more rarely.
  backoff_.alive(received);
  block.lost_blocks = std::exchange(lost_blocks_, 0) + std::exchange(rejoined_, false);
  block.found_blocks = std::exchange(found_blocks_, 0);
  block.dropped_items = std::exchange(dropped_items_, 0);
  handlers_.block(block, received);
}

void BridgeClient::reject(const Block& block, const char* expected) {
  constexpr const char* kinds[] = {"hellos", "tags", "depth frames", "goodbyes"};
  const auto kind = static_cast<std::size_t>(block.kind);
  if (kind < std::size(kinds) && std::string(kinds[kind]) != expected &&
      !std::exchange(told_kind_, true))
    handlers_.event(Severity::warning, std::string("this bridge sends ") + kinds[kind] + ", not " +
                                           expected + ": is it the port of the other device?");
  ++bad_payloads_;
  lost_blocks_ += block.lost_blocks + 1;
  found_blocks_ += block.found_blocks;
  dropped_items_ += block.dropped_items;
}

void BridgeClient::on_hello(const Block& block) {
  const auto hello = read_hello(block.payload);
  if (!hello) return fail("its hello is not the JSON it should be");
  if (std::exchange(greeted_, true)) return;
  hello_ = *hello;
  rejoined_ = connections_ > 1;
  faulted_ = false;
  handlers_.state(DeviceState::streaming, hello_);
}

// Also called from inside the parser and the port: what it destroys is safe to destroy there.
void BridgeClient::fail(const std::string& why) {
  if (!running_) return;
  port_.reset();
  if (backoff_.is_news(why)) handlers_.event(Severity::warning, why);
  if (!running_) return;
  if (!std::exchange(faulted_, true)) handlers_.state(DeviceState::faulted, hello_);
  if (!running_) return;
  timer_.after(backoff_.next(), [this] { connect(); });
}

}  // namespace echofuse::bridge
