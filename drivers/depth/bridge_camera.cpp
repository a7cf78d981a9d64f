// SPDX-License-Identifier: MIT
#include "drivers/depth/bridge_camera.hpp"

#include <algorithm>
#include <utility>

namespace echofuse::depth {
namespace {

constexpr std::uint32_t longest_gap = 1u << 20;

}  // namespace

BridgeCamera::BridgeCamera(port::Loop& loop, std::string address, port::ByteOpener opener)
    : client_(loop, std::move(opener)) {
  info_.sensor = Sensor::depth;
  info_.address = std::move(address);
}

void BridgeCamera::start(SampleSink& sink) {
  sink_ = &sink;
  client_.start(
      {.state = [this](DeviceState state, const bridge::Hello& hello) { on_state(state, hello); },
       .block = [this](const bridge::Block& block,
                       HostTime received) { on_block(block, received); },
       .event = [this](
                    Severity severity,
                    const std::string& text) { sink_->on_event(Sensor::depth, severity, text); }});
}

void BridgeCamera::on_state(DeviceState state, const bridge::Hello& hello) {
  if (state == DeviceState::streaming) {
    info_.model = hello.model;
    info_.serial = hello.serial;
    info_.firmware = hello.firmware;
    info_.axes.clear();  // the first frame brings them
  } else {
    sink_->on_state(Sensor::depth, state, info_);
  }
}

void BridgeCamera::on_block(const bridge::Block& block, HostTime received) {
  auto depth = bridge::read_depth(block.payload);
  if (block.kind != bridge::BlockKind::depth || !depth)
    return client_.reject(block, "depth frames");
  const std::vector<Axis> axes = {depth->x, depth->y};
  if (!std::equal(axes.begin(), axes.end(), info_.axes.begin(), info_.axes.end(), same_axis)) {
    info_.axes = axes;
    sink_->on_state(Sensor::depth, DeviceState::streaming, info_);
  }
  DepthFrame& frame = depth->frame;
  frame.received = received;
  const std::uint64_t lost = lost_before(frame.frame_index, block);
  frame.lost_before = static_cast<std::uint32_t>(std::min<std::uint64_t>(lost, UINT32_MAX));
  ++frames_;
  lost_frames_ += lost;
  sink_->on_depth(std::move(frame));
}

// By the camera's own numbers, which also tell what it lost before the bridge and while there was
// none; by the bridge's where they make no sense.
std::uint64_t BridgeCamera::lost_before(std::uint32_t index, const bridge::Block& block) {
  const auto last = std::exchange(last_index_, index);
  if (last && index - *last - 1 < longest_gap)
    return std::max<std::uint64_t>(index - *last - 1, block.dropped_items);
  return block.dropped_items + block.lost_blocks;
}

std::vector<Counter> BridgeCamera::counters() const {
  auto all = client_.counters();
  all.push_back({"frames", frames_});
  all.push_back({"lost_frames", lost_frames_});
  return all;
}

}  // namespace echofuse::depth
