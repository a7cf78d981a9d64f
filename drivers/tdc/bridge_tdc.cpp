// SPDX-License-Identifier: MIT
#include "drivers/tdc/bridge_tdc.hpp"

namespace echofuse::tdc {

BridgeTdc::BridgeTdc(port::Loop& loop, std::string address, port::ByteOpener opener)
    : address_(std::move(address)), client_(loop, std::move(opener)) {}

void BridgeTdc::start(SampleSink& sink) {
  sink_ = &sink;
  client_.start(
      {.state =
           [this](DeviceState state, const bridge::Hello& hello) {
             sink_->on_state(Sensor::spd, state,
                             {.sensor = Sensor::spd,
                              .address = address_,
                              .model = hello.model,
                              .serial = hello.serial,
                              .firmware = hello.firmware,
                              .axes = {}});
           },
       .block = [this](const bridge::Block& block,
                       HostTime received) { on_block(block, received); },
       .event = [this](Severity severity,
                       const std::string& text) { sink_->on_event(Sensor::spd, severity, text); }});
}

void BridgeTdc::on_block(const bridge::Block& block, HostTime received) {
  const auto tags = bridge::read_tags(block.payload, scratch_);
  if (block.kind != bridge::BlockKind::tags || !tags) return client_.reject(block, "tags");
  tags_ += tags->size();
  lost_items_ += block.dropped_items;
  sink_->on_tags({.received = received,
                  .tags = *tags,
                  .lost_blocks = block.lost_blocks,
                  .lost_items = block.dropped_items});
}

std::vector<Counter> BridgeTdc::counters() const {
  auto all = client_.counters();
  all.push_back({"tags", tags_});
  all.push_back({"lost_items", lost_items_});
  return all;
}

}  // namespace echofuse::tdc
