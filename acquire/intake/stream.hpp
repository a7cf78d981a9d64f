// SPDX-License-Identifier: MIT
// First stage of the intake, for every command that reads devices: checks and repairs the samples,
// and fits the clocks of the devices. The second stage is intake.hpp.
#pragma once
#include "acquire/config/config.hpp"
#include "acquire/intake/clock_fit.hpp"
#include "acquire/intake/sample_check.hpp"
#include "acquire/intake/tag_check.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse::acquire {

// Receives the samples and events of the drivers and passes them to `next`, with repaired tags and
// without lost histograms. Reports each fault to `next` as a warning. clocks() has observed every
// sample before it is passed on, so that it contains the host time of the sample.
class Stream final : public SampleSink {
 public:
  // `next` must outlive this object. If `live` is false, the samples come from recordings, which
  // compute the arrival times from the device clocks: no clock is compared with the arrival times,
  // and the faults of tags are reported at the end.
  Stream(const Config& config, SampleSink& next, bool live = true);

  const SensorClocks& clocks() const { return clocks_; }
  // Ends the stream: passes on the tags that wait for later tags, and reports the faults that have
  // not been reported yet.
  void finish();

 private:
  void on_tags(const TagBlock& block) override;
  void on_histogram(HistogramFrame frame) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_firmware_bias(const FirmwareBias& bias) override { next_.on_firmware_bias(bias); }
  void on_event(Sensor sensor, Severity severity, const std::string& text) override {
    next_.on_event(sensor, severity, text);
  }

  SampleSink& next_;
  bool live_;
  bool bridged_radar_;  // true if a bridge computes the range profiles
  SampleCheck samples_;
  TagCheck tags_;
  TagCheck::Output take_tags_;
  SensorClocks clocks_;
};

}  // namespace echofuse::acquire
