// SPDX-License-Identifier: MIT
// What all simulated devices look at: one scene after the other on one time base.
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

// One scene and what each sensor's physics makes of it.
struct RenderedScene {
  std::int64_t index = -1;
  Scene scene;
  Returns spd, radar;  // the radar's with where each patch is
};

struct SceneSchedule {
  std::string kind = "person";  // that of SceneKind, or mixed
  std::int64_t seed = 1;
  // Each scene stands so long, and goes at a multiple of that on the host's clock, as the daemon's
  // slots do; 0: the first one for ever.
  double hold_s = 0;
  std::vector<SceneSpec> list{};  // instead of the kind; after the last comes the first
};

class ScenePlayer {
 public:
  // Time zero of the player, and of every device clock, is clock.now() here.
  ScenePlayer(const Clock& clock, const Conditions& conditions, const SceneSchedule& schedule);

  const Conditions& conditions() const { return conditions_; }
  HostTime start() const { return start_; }
  HostTime now() const { return clock_.now(); }
  double now_s() const { return seconds(clock_.now() - start_); }
  // The scene that stands at this time, rendered when it is first asked for, and when it goes.
  const RenderedScene& at(double time_s);
  double scene_end_s(double time_s) const;

  // Scene number `index` of a schedule; "mixed" is one person to three letters, as in Lai et al.
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
