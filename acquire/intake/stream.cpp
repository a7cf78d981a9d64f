// SPDX-License-Identifier: MIT
#include "acquire/intake/stream.hpp"

#include <utility>

namespace echofuse::acquire {

Stream::Stream(const Config& config, SampleSink& next, bool live)
    : next_(next),
      live_(live),
      bridged_radar_(!config.radar.address.empty()),
      samples_(config.window_s,
               [&next](Sensor sensor, const std::string& text) {
                 next.on_event(sensor, Severity::warning, text);
               }),
      tags_(config.histogram, live,
            [&next](const std::string& text) {
              next.on_event(Sensor::spd, Severity::warning, text);
            }),
      take_tags_([this](const TagBlock& repaired) {
        clocks_.observe(repaired);
        next_.on_tags(repaired);
      }) {}

void Stream::on_tags(const TagBlock& block) { tags_.take(block, take_tags_); }

void Stream::on_histogram(HistogramFrame frame) {
  if (!samples_.take(frame)) return;
  clocks_.observe(frame);
  next_.on_histogram(std::move(frame));
}

void Stream::on_radar(RadarFrame frame) {
  if (bridged_radar_) samples_.take(frame);
  if (live_) clocks_.observe(frame);
  next_.on_radar(std::move(frame));
}

void Stream::on_depth(DepthFrame frame) {
  samples_.take(frame);
  clocks_.observe(frame);
  next_.on_depth(std::move(frame));
}

void Stream::on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) {
  if (sensor == Sensor::spd && state == DeviceState::ended) tags_.flush(take_tags_);
  next_.on_state(sensor, state, info);
  for (const Axis& axis : info.axes) samples_.take(axis);
}

void Stream::finish() {
  tags_.flush(take_tags_);
  tags_.finish();
  samples_.finish();
}

}  // namespace echofuse::acquire
