// SPDX-License-Identifier: MIT
// The doctor's verdicts on the configured devices, from two seconds of what they send.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/doctor/finding.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// What arrived between begin() and end(), and every complaint since the start.
class Capture final : public SampleSink {
 public:
  explicit Capture(const tdc::HistogramSettings& settings) : histogram_(settings) {}
  void begin() { running_ = true; }
  void end();

  void on_tags(const TagBlock& block) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;

  TagCounts tags;
  std::uint64_t lost_blocks = 0, lost_tags = 0;
  std::map<std::int32_t, std::uint64_t> channels;  // time tags of each
  std::uint64_t radar_frames = 0, radar_lost = 0, profiles = 0, arrays = 0;
  std::vector<std::uint16_t> profile;  // the last one
  std::uint64_t depth_frames = 0, depth_lost = 0, pixels = 0, valid_pixels = 0;
  std::optional<DepthFrame> depth;                 // the last one
  PerSensor<std::vector<std::string>> complaints;  // each once

 private:
  tdc::Histogram histogram_;
  bool running_ = false;
};

// `time_s`: how long the capture ran.
Finding judge_spd(const Capture& capture, const Config& config, double time_s);
Finding judge_radar(const Capture& capture, const Config& config, double time_s);
Finding judge_depth(const Capture& capture, const Config& config, double time_s);

// What a record of these devices takes, from what they sent; a device that sent nothing is counted
// as its configuration has it.
double estimate_record_bytes(const Capture& capture, const Config& config);

}  // namespace echofuse::acquire
