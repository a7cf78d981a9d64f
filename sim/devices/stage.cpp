// SPDX-License-Identifier: MIT
#include "sim/devices/stage.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/exit_code.hpp"
#include "drivers/core/random.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {

Stage::Stage(const Clock& clock, const Conditions& conditions, const Play& play)
    : clock_(clock), conditions_(conditions), play_(play), start_(clock.now()) {}

SceneSpec Stage::spec_of(const Play& play, std::int64_t index) {
  if (!play.list.empty()) return play.list[static_cast<std::size_t>(index) % play.list.size()];
  if (const auto kind = kind_named(play.kind)) return *kind;
  if (play.kind != "mixed")
    throw Error(ExitCode::usage,
                "scene \"" + play.kind + "\" is unknown; expected mixed, " + kind_names());
  Rng rng = make_rng(static_cast<std::uint64_t>(play.seed), static_cast<std::uint64_t>(index));
  return rng() % 4 == 0 ? SceneKind::person : SceneKind::letter;
}

std::int64_t Stage::holds_until(HostTime time) const { return time / from_seconds(play_.hold_s); }

std::int64_t Stage::index_at(double time_s) const {
  if (play_.hold_s <= 0) return 0;
  return holds_until(start_ + from_seconds(std::max(0.0, time_s))) - holds_until(start_);
}

double Stage::until(double time_s) const {
  if (play_.hold_s <= 0) return std::numeric_limits<double>::infinity();
  const std::int64_t next = holds_until(start_) + index_at(time_s) + 1;
  return seconds(next * from_seconds(play_.hold_s) - start_);
}

const RenderedScene& Stage::at(double time_s) {
  const std::int64_t index = index_at(time_s);
  if (index == rendered_.index) return rendered_;
  rendered_.scene =
      make_scene(conditions_, spec_of(play_, index), static_cast<std::uint64_t>(play_.seed),
                 static_cast<std::uint64_t>(index));
  rendered_.spd = spd_returns(rendered_.scene, conditions_);
  // The reflector is put before each sensor in turn; here, before both at once.
  Scene for_radar = rendered_.scene;
  if (for_radar.label == "reflector") for_radar.plates[0].centre.x = -conditions_.baseline_m;
  rendered_.radar = radar_returns(for_radar, conditions_);
  Rng rng = make_rng(static_cast<std::uint64_t>(play_.seed) + 1, static_cast<std::uint64_t>(index));
  roughen(rendered_.radar, conditions_, rng);
  rendered_.index = index;
  return rendered_;
}

}  // namespace echofuse::sim
