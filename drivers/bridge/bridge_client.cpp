// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_client.hpp"

#include <iterator>
#include <utility>

namespace echofuse::bridge {
namespace {
// A working sender is silent for at most 1 s, plus any delay on a busy machine. The timeout of 4 s
// also ends the wait for a block with a corrupt length. Therefore, the largest blocks (16 MiB) must
// arrive at 4 MB/s or faster.
constexpr std::chrono::seconds check_pause{1};
constexpr int timeout_checks = 4;

}  // namespace

BridgeClient::BridgeClient(port::Loop& loop, port::ByteOpener opener, std::string programs)
    : opener_(std::move(opener)), programs_(std::move(programs)), loop_(loop), timer_(loop) {}

void BridgeClient::start(Handlers handlers) {
  handlers_ = std::move(handlers);
  running_ = true;
  handlers_.state(DeviceState::connecting, hello_);
  connect();
}

void BridgeClient::stop() {
  running_ = false;
  timer_.cancel();
  port_.reset();
}

std::vector<Counter> BridgeClient::counters() const {
  std::vector<Counter> all = counters_of(parser_.counts());
  all.insert(all.end(), {{"bad_payloads", bad_payloads_}, {"connections", connections_}});
  return all;
}

void BridgeClient::connect() {
  port_ = opener_();
  greeted_ = connected_ = kind_reported_ = false;
  quiet_checks_ = 0;
  blocks_seen_ = parser_.counts().blocks;
  port_->open({.opened =
                   [this] {
                     ++connections_;
                     connected_ = true;
                   },
               .bytes =
                   [this](ByteView bytes) {
                     const HostTime received = loop_.now();
                     parser_.feed(bytes, [&](const Block& block) { on_block(block, received); });
                     if (port_ && parser_.broken()) fail(parser_.broken());
                     const auto& counts = parser_.counts();
                     if (port_ && port_->recorded() && counts.bad_crcs + counts.bad_headers > 0 &&
                         reasons_.insert("damaged").second)
                       handlers_.event(Severity::warning, "damaged blocks are skipped");
                   },
               .gone =
                   [this](const Failure& failure) {
                     const bool refused = failure.code == std::errc::connection_refused;
                     fail(failure.text() +
                          (refused ? "; is its bridge running? Start " + programs_ : ""));
                   }});
  parser_.reset(port_->recorded());
  watch();
}

void BridgeClient::watch() {
  timer_.after(check_pause, [this] { check_liveness(); });
}

// Considers the bridge alive if it has sent a block since the last check. Blocks received before a
// hello do not count.
void BridgeClient::check_liveness() {
  const bool alive =
      std::exchange(blocks_seen_, parser_.counts().blocks) != parser_.counts().blocks && greeted_;
  quiet_checks_ = alive ? 0 : quiet_checks_ + 1;
  constexpr std::uint64_t heartbeats_bytes = 1 << 20;
  const std::uint64_t bytes = parser_.counts().bytes;
  if (bytes - std::exchange(bytes_seen_, bytes) < heartbeats_bytes) parser_.give_back();
  if (quiet_checks_ == timeout_checks)
    return fail(greeted_      ? "no block received for 4 s"
                : !connected_ ? "no connection within 4 s"
                              : "no hello block within 4 s; expected an echofuse bridge");
  watch();
}

// Ignores blocks that the parser still delivers after stop() or after a failure.
void BridgeClient::on_block(Block block, HostTime received) {
  if (!running_ || !port_) return;
  // Losses reported by undelivered blocks are added to those of the next delivered block.
  lost_blocks_ += block.lost_blocks;
  dropped_items_ += block.dropped_items;
  if (block.kind == BlockKind::bye)
    return fail("bridge closed the connection: device unplugged, or another client connected");
  if (block.kind == BlockKind::hello) return on_hello(block);
  if (!greeted_) {
    ++lost_blocks_;
    return;
  }
  // Resets the back-off only after a data block, so that a bridge that closes the connection after
  // its hello is retried at increasing intervals.
  backoff_.alive(received);
  block.lost_blocks = std::exchange(lost_blocks_, 0);
  block.dropped_items = std::exchange(dropped_items_, 0);
  handlers_.block(block, received);
}

void BridgeClient::reject(const Block& block, BlockKind expected, const std::string& reason) {
  const auto text_of = [](BlockKind kind) {
    constexpr const char* kinds[] = {"hellos",   "tags",       "depth frames",
                                     "goodbyes", "histograms", "range profiles"};
    return std::string(kinds[static_cast<std::size_t>(kind)]);
  };
  const bool other = block.kind != expected;
  constexpr std::size_t max_reasons = 20;
  if (!other && reasons_.size() < max_reasons && reasons_.insert(reason).second)
    handlers_.event(Severity::error, "its " + text_of(expected) + " have " + reason);
  if (other && !std::exchange(kind_reported_, true))
    handlers_.event(Severity::error, "this bridge sends " + text_of(block.kind) + ", not " +
                                         text_of(expected) +
                                         (block.kind == BlockKind::histogram
                                              ? "; add \"sends\": \"histograms\" to its hello block"
                                              : "; check the port in its address"));
  ++bad_payloads_;
  lost_blocks_ += block.lost_blocks + 1;
  dropped_items_ += block.dropped_items;
}

void BridgeClient::on_hello(const Block& block) {
  const auto hello = read_hello(block.payload);
  if (!hello) return fail(hello.failure().what, Severity::error);
  if (std::exchange(greeted_, true)) return;
  hello_ = *hello;
  lost_blocks_ += connections_ > 1;
  faulted_ = false;
  handlers_.state(DeviceState::streaming, hello_);
}

// Destroys the port. Handlers of the parser and of the port may call this function.
void BridgeClient::fail(const std::string& why, Severity severity) {
  if (!running_) return;
  port_.reset();
  if (backoff_.is_news(why)) handlers_.event(severity, why);
  if (!running_) return;
  if (!std::exchange(faulted_, true)) handlers_.state(DeviceState::faulted, hello_);
  if (!running_) return;
  timer_.after(backoff_.next(), [this] { connect(); });
}

}  // namespace echofuse::bridge
