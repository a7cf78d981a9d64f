// SPDX-License-Identifier: MIT
#include "drivers/tdc/bridge_tdc.hpp"

#include <utility>

namespace echofuse::tdc {

void BridgeTdc::on_block(const bridge::Block& block, HostTime received) {
  histograms_ ? on_histogram(block, received) : on_tags(block, received);
}

void BridgeTdc::on_tags(const bridge::Block& block, HostTime received) {
  const auto tags = bridge::read_tags(block.payload, scratch_);
  if (block.kind != bridge::BlockKind::tags || !tags)
    return client_.reject(block, "tags", tags ? "" : tags.failure().what);
  items_ += tags->size();
  lost_ += block.dropped_items;
  sink_->on_tags({.received = received,
                  .tags = *tags,
                  .lost_blocks = block.lost_blocks,
                  .lost_items = block.dropped_items});
}

void BridgeTdc::on_histogram(const bridge::Block& block, HostTime received) {
  auto read = bridge::read_histogram(block.payload);
  if (block.kind != bridge::BlockKind::histogram || !read)
    return client_.reject(block, "histograms", read ? "" : read.failure().what);
  HistogramFrame& frame = read->frame;
  if (const Zones& stated = hello_.zones; stated.empty())
    read->axis.zones.resize(frame.zones);
  else if (stated.size() == frame.zones)
    read->axis.zones = stated;
  else
    return client_.reject(block, "histograms",
                          std::to_string(frame.zones) + " zones, but the hello block lists " +
                              std::to_string(stated.size()));
  announce({read->axis});
  frame.received = received;
  frame.lost_before = block.lost_blocks + block.dropped_items;
  ++items_;
  lost_ += frame.lost_before;
  sink_->on_histogram(std::move(frame));
}

}  // namespace echofuse::tdc
