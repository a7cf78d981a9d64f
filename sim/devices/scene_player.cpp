// SPDX-License-Identifier: MIT
#include "sim/devices/scene_player.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/core/random.hpp"
#include "drivers/util/exit_code.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {

namespace {

// Moves all radar patches of the reflector plate to its centre, because a corner reflector returns
// echoes from its apex at any orientation. The power is multiplied by the square of the distance,
// as if larger corner reflectors were used at larger distances.
void gather_reflector(Vec3 centre, const Conditions& c, Returns& returns) {
  const double x = centre.x - radar_x_m(c), range = std::hypot(x, centre.y, centre.z);
  for (std::size_t k = 0; k < returns.place.size(); ++k) {
    if (returns.place[k].person != Returns::reflector) continue;
    returns.range_m[k] = range + c.radar_bias_m;
    returns.weight[k] *= c.reflector_z_m * c.reflector_z_m;
    returns.place[k].x = static_cast<float>(x / range);
    returns.place[k].y = static_cast<float>(centre.y / range);
  }
}

}  // namespace

ScenePlayer::ScenePlayer(const Clock& clock, const Conditions& conditions,
                         const SceneSchedule& schedule)
    : clock_(clock), conditions_(conditions), schedule_(schedule), start_(clock.now()) {}

SceneSpec ScenePlayer::spec_of(const SceneSchedule& schedule, std::int64_t index) {
  if (!schedule.list.empty())
    return schedule.list[static_cast<std::size_t>(index) % schedule.list.size()];
  if (const auto kind = kind_named(schedule.kind)) return *kind;
  if (schedule.kind != "mixed")
    throw Error(ExitCode::usage,
                "scene \"" + schedule.kind + "\" is unknown; expected mixed, " + kind_names());
  Rng rng = make_rng(static_cast<std::uint64_t>(schedule.seed), static_cast<std::uint64_t>(index));
  return rng() % 4 == 0 ? SceneKind::person : SceneKind::letter;
}

std::int64_t ScenePlayer::scenes_until(HostTime time) const {
  return time / from_seconds(schedule_.hold_s);
}

std::int64_t ScenePlayer::index_at(double time_s) const {
  if (schedule_.hold_s <= 0) return 0;
  return scenes_until(start_ + from_seconds(std::max(0.0, time_s))) - scenes_until(start_);
}

double ScenePlayer::scene_end_s(double time_s) const {
  if (schedule_.hold_s <= 0) return std::numeric_limits<double>::infinity();
  const std::int64_t next = scenes_until(start_) + index_at(time_s) + 1;
  return seconds(next * from_seconds(schedule_.hold_s) - start_);
}

const RenderedScene& ScenePlayer::at(double time_s) {
  const std::int64_t index = index_at(time_s);
  if (index == rendered_.index) return rendered_;
  rendered_.scene =
      make_scene(conditions_, spec_of(schedule_, index), static_cast<std::uint64_t>(schedule_.seed),
                 static_cast<std::uint64_t>(index));
  rendered_.spd = spd_returns(rendered_.scene, conditions_);
  Scene for_radar = rendered_.scene;
  const bool reflector = for_radar.label == "reflector";
  if (reflector && conditions_.reflector_before == "each")
    for_radar.plates[0].centre.x = radar_x_m(conditions_);
  Conditions with_places = conditions_;
  with_places.radar_antennas = std::max<std::int64_t>(1, conditions_.radar_antennas);
  rendered_.radar = radar_returns(for_radar, with_places);
  if (reflector) gather_reflector(for_radar.plates[0].centre, conditions_, rendered_.radar);
  rendered_.index = index;
  return rendered_;
}

}  // namespace echofuse::sim
