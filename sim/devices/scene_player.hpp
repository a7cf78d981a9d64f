// SPDX-License-Identifier: MIT
// Scene source of all simulated devices: shows one scene after the other on a common time base.
// Threading: one thread.
#pragma once
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "drivers/core/clock.hpp"
#include "sim/scene/conditions.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {

// Scene, and its returns for each sensor.
struct RenderedScene {
  std::int64_t index = -1;
  Scene scene;
  Returns spd, radar;  // the radar's include the place of each patch
};

struct SceneSchedule {
  std::string kind = "person";  // a name of SceneKind, or mixed
  std::int64_t seed = 1;
  // Time per scene. Scenes change at multiples of it on the host's clock, like the daemon's slots.
  // 0: only the first scene.
  double hold_s = 0;
  std::vector<SceneSpec> list{};  // replaces the kind; repeats after the last
};

class ScenePlayer {
 public:
  // Time zero of the player, and of every device clock, is clock.now() here.
  ScenePlayer(const Clock& clock, const Conditions& conditions, const SceneSchedule& schedule);

  const Conditions& conditions() const { return conditions_; }
  HostTime start() const { return start_; }
  HostTime now() const { return clock_.now(); }
  double now_s() const { return seconds(clock_.now() - start_); }
  // at() returns the scene at this time, rendered at its first use. scene_end_s() returns its end.
  const RenderedScene& at(double time_s);
  double scene_end_s(double time_s) const;

  // Returns scene `index` of a schedule; "mixed" is one person to three letters, as in Lai et al.
  static SceneSpec spec_of(const SceneSchedule& schedule, std::int64_t index);

 private:
  std::int64_t index_at(double time_s) const;
  std::int64_t scenes_until(HostTime time) const;

  const Clock& clock_;
  Conditions conditions_;
  SceneSchedule schedule_;
  HostTime start_;
  RenderedScene rendered_;
};

}  // namespace echofuse::sim
