// SPDX-License-Identifier: MIT
#include "drivers/bridge/bridge_driver.hpp"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "drivers/util/program.hpp"

namespace echofuse::bridge {
namespace {

constexpr std::uint32_t longest_gap = 1u << 20;

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
