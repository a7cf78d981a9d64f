// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_driver.hpp"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "drivers/util/program.hpp"

namespace echofuse::bridge {
namespace {

constexpr std::uint32_t longest_gap = 1u << 20;
// value that some cameras report for pixels without a return
constexpr std::uint16_t invalid_mm = 65535;

namespace fs = std::filesystem;

// Returns the path of one of echofuse's bridge programs, either installed or in the source tree. If
// neither exists, returns only the program's file name.
std::string path_of(const std::string& bridge) {
  std::error_code none;
  const std::string name = "echofuse-bridge-" + bridge;
  if (fs::exists(program_folder() / name, none)) return (program_folder() / name).string();
  for (fs::path folder = program_folder(); folder.has_relative_path();
       folder = folder.parent_path())
    if (const fs::path script = folder / "scripts/bridges" / (bridge + ".py");
        fs::exists(script, none))
      return script.string();
  return name;
}

std::string programs_for(Sensor sensor) {
  if (sensor == Sensor::spd) return path_of("timetagger");
  if (sensor == Sensor::depth) return path_of("orbbec") + " or " + path_of("realsense");
  return "your own bridge, for example based on " + path_of("example");
}

}  // namespace

BridgeDriver::BridgeDriver(Sensor sensor, port::Loop& loop, std::string address,
                           port::ByteOpener opener)
    : client_(loop, std::move(opener), programs_for(sensor)) {
  info_.sensor = sensor;
  info_.address = std::move(address);
}

void BridgeDriver::start(SampleSink& sink) {
  sink_ = &sink;
  client_.start(
      {.state = [this](DeviceState state, const Hello& hello) { on_state(state, hello); },
       .block = [this](const Block& block, HostTime received) { on_block(block, received); },
       .event = [this](
                    Severity severity,
                    const std::string& text) { sink_->on_event(info_.sensor, severity, text); }});
}

void BridgeDriver::on_state(DeviceState state, const Hello& hello) {
  histograms_ = hello.sends == "histograms";
  hello_ = hello;
  if (state == DeviceState::streaming) {
    info_.model = hello.model;
    info_.serial = hello.serial;
    info_.firmware = hello.firmware;
    info_.axes.clear();  // the axes are set again by the first frame of the connection
    if (info_.sensor != Sensor::spd || histograms_) return;
  }
  sink_->on_state(info_.sensor, state, info_);
}

void BridgeDriver::on_block(const Block& block, HostTime received) {
  const auto [expected, take] =
      info_.sensor == Sensor::radar
          ? std::pair(BlockKind::range_profile, &BridgeDriver::take_profile)
      : info_.sensor == Sensor::depth ? std::pair(BlockKind::depth, &BridgeDriver::take_depth)
      : histograms_ ? std::pair(BlockKind::histogram, &BridgeDriver::take_histogram)
                    : std::pair(BlockKind::tags, &BridgeDriver::take_tags);
  if (block.kind != expected) return client_.reject(block, expected, "");
  if (const std::string fault = (this->*take)(block, received); !fault.empty())
    client_.reject(block, expected, fault);
}

std::string BridgeDriver::take_tags(const Block& block, HostTime received) {
  const auto tags = read_tags(block.payload, scratch_);
  if (!tags) return tags.failure().what;
  items_ += tags->size();
  lost_ += block.dropped_items;
  sink_->on_tags({.received = received,
                  .tags = *tags,
                  .lost_blocks = block.lost_blocks,
                  .lost_items = block.dropped_items});
  return {};
}

std::string BridgeDriver::take_histogram(const Block& block, HostTime received) {
  auto read = read_histogram(block.payload);
  if (!read) return read.failure().what;
  HistogramFrame& frame = read->frame;
  const Zones& stated = hello_.zones;
  if (!stated.empty() && stated.size() != frame.zones)
    return std::to_string(frame.zones) + " zones, but the hello block lists " +
           std::to_string(stated.size());
  read->axis.zones = stated.empty() ? Zones(frame.zones) : stated;
  announce({read->axis});
  frame.received = received;
  frame.lost_before = block.lost_blocks + block.dropped_items;
  ++items_;
  lost_ += frame.lost_before;
  sink_->on_histogram(std::move(frame));
  return {};
}

std::string BridgeDriver::take_profile(const Block& block, HostTime received) {
  auto read = read_profile(block.payload);
  if (!read) return read.failure().what;
  announce({read->axis});
  read->frame.received = received;
  read->frame.lost_before = lost_before(read->frame.frame_number, block);
  ++items_;
  sink_->on_radar(std::move(read->frame));
  return {};
}

std::string BridgeDriver::take_depth(const Block& block, HostTime received) {
  auto read = read_depth(block.payload);
  if (!read) return read.failure().what;
  announce({read->x, read->y});
  read->frame.received = received;
  std::ranges::replace(read->frame.depth_mm, invalid_mm, std::uint16_t{0});
  read->frame.lost_before = lost_before(read->frame.frame_number, block);
  ++items_;
  sink_->on_depth(std::move(read->frame));
  return {};
}

void BridgeDriver::announce(std::vector<Axis> axes) {
  if (std::ranges::equal(axes, info_.axes, same_axis)) return;
  info_.axes = std::move(axes);
  sink_->on_state(info_.sensor, DeviceState::streaming, info_);
}

std::uint32_t BridgeDriver::lost_before(std::uint32_t number, const Block& block) {
  std::uint64_t lost = block.dropped_items + block.lost_blocks;
  const auto last = std::exchange(last_number_, number);
  if (last && number - *last - 1 < longest_gap)
    lost = std::max<std::uint64_t>(number - *last - 1, block.dropped_items);
  lost_ += lost;
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(lost, UINT32_MAX));
}

std::vector<Counter> BridgeDriver::counters() const {
  const bool tags = info_.sensor == Sensor::spd && !histograms_;
  auto all = client_.counters();
  all.push_back({tags ? "tags" : histograms_ ? "histograms" : "frames", items_});
  all.push_back({tags ? "lost_items" : histograms_ ? "lost_histograms" : "lost_frames", lost_});
  return all;
}

}  // namespace echofuse::bridge
