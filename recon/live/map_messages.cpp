// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "recon/live/pictures.hpp"
#include "recon/live/run_messages.hpp"

namespace echofuse::view {
namespace {

using Json = nlohmann::json;
constexpr double track_s = 60;
constexpr std::size_t max_places = 30;  // maximum number of points in a track
constexpr std::size_t max_places_kept = 1000;
constexpr std::size_t max_scored = 100;  // maximum number of records scored for a saved page

}  // namespace

// Adds the camera image and its depth map. If there is a model, also adds the predicted map and the
// track of the body.
void RunMessages::add_maps(MessageWriter& out, Json& head, const record::FusedRecord& r,
                           const record::RunReader& run) {
  const std::vector<Axis> axes = run.axes();
  const Axis *x = find(axes, "depth_x"), *y = find(axes, "depth_y");
  const bool camera = r.has(Sensor::depth) && x && y;
  const auto holes = [](const auto& values) {
    const auto empty = std::ranges::count_if(values, [](auto v) { return !(v > 0); });
    return static_cast<double>(empty) /
           static_cast<double>(std::max<std::size_t>(values.size(), 1));
  };
  if (camera) {
    const record::MapGrid grid = record::map_grid_of(axes);
    const Picture picture = thinned(r.depth_mm, y->count, x->count);
    const std::vector<float> map = map_of(r, axes, grid);
    out.add<std::uint16_t>("camera", picture.mm, {picture.height, picture.width});
    out.add<float>("map", map, {grid.size, grid.size});
    head["holes"] = {{"camera", holes(r.depth_mm)}, {"map", holes(map)}};
  }
  if (!model_) return;
  Reconstruction made = model_->reconstruct(run, r.index, true);
  if (camera) model_->compare(made, map_of(r, axes, made.grid));
  const auto given = [](const std::optional<double>& v) { return v ? number(*v) : Json(); };
  std::optional<double> interval_m = made.lateral_interval_90_m;
  if (interval_m) *interval_m *= group_.interval_factor;
  head["reconstruction"] = {{"fault", made.fault},
                            {"note", made.note},
                            {"seen", model_->saw(run_.info().uuid, r.index)},
                            {"half_tangent", made.grid.half_tangent},
                            {"x_m", given(made.x_m)},
                            {"z_m", given(made.z_m)},
                            {"lateral_interval_90_m", given(interval_m)},
                            {"iou", given(made.iou)},
                            {"lateral_error_m", given(made.lateral_error_m)}};
  const std::size_t side = made.grid.size;
  if (!made.map_m.empty()) out.add<float>("reconstruction", made.map_m, {side, side});
  if (!made.deviation_m.empty()) out.add<float>("deviation", made.deviation_m, {side, side});
  if (std::exchange(places_edition_, run_.edition()) != run_.edition()) places_.clear();
  places_[r.index] = place_of(made);
  const std::vector<float> places = track(run, r.index);
  out.add<float>("track", places, {places.size() / 4, 4});
}

std::vector<std::int64_t> RunMessages::worst_and_median() const {
  std::vector<std::int64_t> unseen;
  std::vector<std::pair<double, std::int64_t>> scored;
  if (!model_) return unseen;
  for (const Outline& o : run_.outlines())
    if (o.valid.contains(Sensor::depth) && !model_->saw(run_.info().uuid, o.index))
      unseen.push_back(o.index);
  run_.with_reader([&](const record::RunReader& run) {
    for (const std::int64_t index : spread(unseen, max_scored)) {
      Reconstruction made = model_->reconstruct(run, index, false);
      model_->compare(made, map_of(run.read(index), run.axes(), made.grid));
      if (made.iou) scored.emplace_back(*made.iou, index);
    }
  });
  if (scored.empty()) return {};
  std::ranges::sort(scored);
  return {scored.front().second, scored[scored.size() / 2].second};
}

RunMessages::TrackPoint RunMessages::place_of(const Reconstruction& made) {
  const auto given = [](const std::optional<double>& v) {
    return v ? static_cast<float>(*v) : std::nanf("");
  };
  return {given(made.x_m), given(made.z_m), given(made.lateral_interval_90_m)};
}

// Returns the track of the body over the minute that ends with record `index`. Each point contains
// the age (s), x, z, and the 90 % interval of x (m).
std::vector<float> RunMessages::track(const record::RunReader& run, std::int64_t index) {
  std::vector<const Outline*> minute;
  const auto& all = run_.outlines();
  for (auto o = all.rbegin(); o != all.rend(); ++o) {
    if (o->index > index) continue;
    if (!minute.empty() && minute.front()->start - o->start > from_seconds(track_s)) break;
    minute.push_back(&*o);
  }
  if (places_.size() > max_places_kept && !minute.empty())
    places_.erase(places_.begin(), places_.lower_bound(minute.back()->index));
  const auto step = static_cast<std::int64_t>(minute.size() / max_places + 1);
  std::vector<float> out;
  for (const Outline* o : minute) {
    if (o->index != index && o->index % step != 0) continue;
    auto known = places_.find(o->index);
    if (known == places_.end())
      known = places_.emplace(o->index, place_of(model_->reconstruct(run, o->index, false))).first;
    const auto& [x_m, z_m, interval_90_m] = known->second;
    const float interval_m = interval_90_m * static_cast<float>(group_.interval_factor);
    const double age_s = seconds(minute.front()->start - o->start);
    out.insert(out.end(), {static_cast<float>(age_s), x_m, z_m, interval_m});
  }
  return out;
}

}  // namespace echofuse::view
