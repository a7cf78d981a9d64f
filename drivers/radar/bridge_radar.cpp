// SPDX-License-Identifier: MIT
#include "drivers/radar/bridge_radar.hpp"

#include <utility>

namespace echofuse::radar {

void BridgeRadar::on_block(const bridge::Block& block, HostTime received) {
  auto profile = bridge::read_profile(block.payload);
  if (block.kind != bridge::BlockKind::range_profile || !profile)
    return client_.reject(block, "range profiles", profile ? "" : profile.failure().what);
  announce({profile->axis});
  RadarFrame& frame = profile->frame;
  frame.received = received;
  frame.lost_before = lost_before(frame.frame_number, block);
  ++items_;
  sink_->on_radar(std::move(frame));
}

}  // namespace echofuse::radar
