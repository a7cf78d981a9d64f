// SPDX-License-Identifier: MIT
// Provides all simulated devices with the same sequence of scenes on a common time base. Threading:
// use in one thread only.
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

// A scene, and the returns received from it by each sensor.
struct RenderedScene {
  std::int64_t index = -1;
  Scene scene;
  Returns spd, radar;  // `radar` contains the origin of each patch (Returns::place)
};

struct SceneSchedule {
  std::string kind = "person";  // name of a SceneKind, or mixed
  std::int64_t seed = 1;
  // Duration of each scene, s; 0: only the first scene is shown. Scenes change at multiples of
  // `hold_s` on the host clock, as the slots of the daemon do.
  double hold_s = 0;
  std::vector<SceneSpec> list{};  // scenes shown repeatedly in this order; replaces `kind`
};

class ScenePlayer {
 public:
  // Laboratory time is zero for the player and all device clocks when the player is constructed.
  ScenePlayer(const Clock& clock, const Conditions& conditions, const SceneSchedule& schedule);

  const Conditions& conditions() const { return conditions_; }
  HostTime start() const { return start_; }
  HostTime now() const { return clock_.now(); }
  double now_s() const { return seconds(clock_.now() - start_); }
  // at() returns the scene at this time. The first call for a scene renders it. scene_end_s()
  // returns the time at which the scene ends.
  const RenderedScene& at(double time_s);
  double scene_end_s(double time_s) const;

  // Returns scene `index` of a schedule. The kind "mixed" yields, on average, one person scene for
  // every three letter scenes, as in Lai et al. (2024).
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
