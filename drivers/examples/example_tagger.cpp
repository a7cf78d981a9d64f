// SPDX-License-Identifier: MIT
#include "drivers/examples/example_tagger.hpp"

#include <algorithm>
#include <utility>

namespace echofuse::examples {
namespace {

using namespace std::chrono_literals;
constexpr auto shortest_pause = 100ms, longest_pause = 2000ms, poll_pause = 5ms;

}  // namespace

ExampleTagger::ExampleTagger(port::Loop& loop, VendorBoard board, std::string address)
    : loop_(loop), board_(std::move(board)), timer_(loop) {
  info_ = {Sensor::spd, std::move(address), "Example tagger", "0001", "1.0", {}};
}

void ExampleTagger::start(SampleSink& sink) {
  sink_ = &sink;
  pause_ = shortest_pause;
  sink_->on_state(Sensor::spd, DeviceState::connecting, info_);
  connect();
}

// Calls the vendor's library on the loop's thread. If the library's functions block, call them on a
// separate thread and post their results to the loop.
void ExampleTagger::connect() {
  if (!board_.open()) {
    timer_.after(pause_, [this] { connect(); });
    pause_ = std::min(2 * pause_, std::chrono::milliseconds(longest_pause));
    return;
  }
  pause_ = shortest_pause;
  sink_->on_state(Sensor::spd, DeviceState::streaming, info_);
  poll();
}

void ExampleTagger::poll() {
  tags_.clear();
  std::uint64_t lost = 0;
  if (!board_.read(tags_, lost)) {
    ++reconnects_;
    sink_->on_event(Sensor::spd, Severity::warning, "the tagger was unplugged");
    sink_->on_state(Sensor::spd, DeviceState::faulted, info_);
    return timer_.after(pause_, [this] { connect(); });
  }
  items_ += tags_.size(), lost_ += lost;
  if (!tags_.empty() || lost > 0)
    sink_->on_tags({.received = loop_.now(), .tags = tags_, .lost_items = lost});
  timer_.after(poll_pause, [this] { poll(); });
}

std::vector<Counter> ExampleTagger::counters() const {
  return {{"items", items_}, {"lost", lost_}, {"reconnects", reconnects_}};
}

}  // namespace echofuse::examples
