// SPDX-License-Identifier: MIT
#pragma once
#include <chrono>
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::test {

// Sink that stores all samples and events received from a driver.
struct KeepingSink : SampleSink {
  void on_tags(const TagBlock& block) override {
    blocks.push_back(block);
    tags.insert(tags.end(), block.tags.begin(), block.tags.end());
    blocks.back().tags = {};
  }
  void on_histogram(HistogramFrame frame) override { histograms.push_back(std::move(frame)); }
  void on_radar(RadarFrame frame) override { radar.push_back(std::move(frame)); }
  void on_depth(DepthFrame frame) override { depth.push_back(std::move(frame)); }
  void on_state(Sensor, DeviceState state, const DeviceInfo& device) override {
    states.push_back(state);
    info = device;
  }
  void on_firmware_bias(const FirmwareBias& bias) override { biases.push_back(bias); }
  void on_event(Sensor, Severity, const std::string& text) override { events.push_back(text); }

  DeviceState state() const { return states.empty() ? DeviceState::ended : states.back(); }
  std::size_t calls() const {
    return blocks.size() + radar.size() + depth.size() + states.size() + events.size();
  }

  std::vector<TagBlock> blocks;
  std::vector<Tag> tags;
  std::vector<HistogramFrame> histograms;
  std::vector<RadarFrame> radar;
  std::vector<DepthFrame> depth;
  std::vector<DeviceState> states;
  std::vector<FirmwareBias> biases;
  std::vector<std::string> events;
  DeviceInfo info;
};

// Runs the loop until the condition is true. Returns false if the condition is still false after
// `limit`.
template <class Condition>
bool run_until(port::Loop& loop, Condition condition,
               std::chrono::milliseconds limit = std::chrono::seconds(10)) {
  loop.run_until(condition, loop.now() + limit);
  return condition();
}

inline std::uint64_t counter(const Driver& driver, const std::string& name) {
  for (const Counter& c : driver.counters())
    if (c.name == name) return c.value;
  throw std::runtime_error("no counter " + name);
}

}  // namespace echofuse::test
