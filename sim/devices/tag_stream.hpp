// SPDX-License-Identifier: MIT
// Generates the tags of the current scene in real time, in blocks, which a device then sends.
#pragma once
#include <functional>

#include "sim/devices/device.hpp"

namespace echofuse::sim {

class TagStream {
 public:
  using Emit = std::function<void(ByteView tags, std::size_t count)>;
  using Lose = std::function<void(std::uint64_t tags)>;

  TagStream(ScenePlayer& player, const TdcOptions& options);
  // Multiplies the photon counts of all later pulses by `gain`.
  void set_gain(double gain) { source_.set_gain(gain); }
  // Starts the stream at the current time. Earlier pulses are skipped.
  void start();
  // Calls `emit` with blocks that together contain all tags up to the current time. A block
  // contains tags of one scene and spans at most TdcOptions::longest. If the stream is more than
  // one second behind, calls `lose` with the number of skipped tags.
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
