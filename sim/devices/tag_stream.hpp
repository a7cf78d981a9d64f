// SPDX-License-Identifier: MIT
// Tags of a scene in real time, in blocks for the device that sends them.
#pragma once
#include <functional>

#include "sim/devices/device.hpp"

namespace echofuse::sim {

class TagStream {
 public:
  using Emit = std::function<void(ByteView tags, std::size_t count)>;
  using Lose = std::function<void(std::uint64_t tags)>;

  TagStream(ScenePlayer& player, const TdcOptions& options);
  // Scales the photons of later pulses.
  void set_gain(double gain) { source_.set_gain(gain); }
  // Starts the tags at this time.
  void start();
  // Emits the pulses up to now, in blocks of one scene and at most the longest block's time span.
  // Pulses later than the device's memory of one second are lost.
  void advance(const Emit& emit, const Lose& lose);

 private:
  std::int64_t pulse_at(double time_s) const;
  double time_of(std::int64_t pulse) const;
  void select_scene(double time_s);

  ScenePlayer& player_;
  double longest_block_s_;
  PhotonSource source_;
  std::int64_t next_pulse_ = 0, scene_index_ = -1;
};

}  // namespace echofuse::sim
