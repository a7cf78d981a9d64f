// SPDX-License-Identifier: MIT
#include "recon/estimator/separate.hpp"

#include <algorithm>
#include <cmath>

#include "recon/models/body/split_bodies.hpp"
#include "recon/uncertainty/predictors.hpp"

namespace echofuse::recon {
namespace {

// Records of one body each: rows 2 k and 2 k + 1 are the bodies of the record places[k].
struct Halves {
  Dataset data;
  Rows places;
};

// Of the given ones of the rows, those that can be taken apart.
Halves halves_of(const TrainedModel& by, const Dataset& data, const Rows& rows,
                 const Rows& places) {
  const std::size_t bins = by.features.spd_count();
  Rows twice;
  Halves out;
  std::vector<SplitBodies> found;
  for (const std::size_t place : places) {
    auto split = split_bodies(by.alignment, by.features.raw_inputs(data, {rows[place]}).row(0));
    if (!split) continue;
    twice.insert(twice.end(), 2, rows[place]);
    out.places.push_back(place), found.push_back(std::move(*split));
  }
  out.data = part_of(data, twice);
  for (std::size_t i = 0; i < twice.size(); ++i) {
    const auto& raw = found[i / 2].parts[i % 2].raw_inputs;
    std::copy_n(raw.begin(), bins, out.data.spd.row(i).begin());
    std::copy(raw.begin() + static_cast<std::ptrdiff_t>(bins), raw.end(),
              out.data.radar.row(i).begin());
  }
  return out;
}

// Where either shows a body, the nearer one.
void compose(std::span<const float> a, std::span<const float> b, const Scene& scene,
             std::span<float> out) {
  for (std::size_t p = 0; p < out.size(); ++p) {
    const bool in_a = a[p] != scene.background[p], in_b = b[p] != scene.background[p];
    out[p] = in_a && in_b ? std::min(a[p], b[p]) : in_a ? a[p] : b[p];
  }
}

void compose(const SoftMaps& halves, std::size_t k, SoftMaps& out, std::size_t to) {
  const auto pa = halves.foreground_probability.row(2 * k),
             pb = halves.foreground_probability.row(2 * k + 1);
  const auto za = halves.depth.row(2 * k), zb = halves.depth.row(2 * k + 1);
  const auto share = out.foreground_probability.row(to), depth = out.depth.row(to);
  for (std::size_t p = 0; p < share.size(); ++p) {
    share[p] = 1 - (1 - pa[p]) * (1 - pb[p]);
    depth[p] = pa[p] > pb[p] ? za[p] : zb[p];
  }
}

FoundBody body_of(std::span<const float> map, const Scene& scene, double lateral_interval_90_m) {
  const auto place = place_of(map, scene.background, scene.grid);
  if (!place) return {NAN, NAN, lateral_interval_90_m};
  const auto z = double{place->depth_m};
  return {double{place->tangent} * z, z, lateral_interval_90_m};
}

}  // namespace

void separate_bodies(const TrainedModel& model, const Dataset& data, const Rows& rows,
                     Prediction& made, SoftMaps* soft) {
  const bool antennas = model.features.array_count() > 0;
  const TrainedModel& by =
      antennas && model.fallback && both_sensors(model.fallback->features.inputs) ? *model.fallback
                                                                                  : model;
  if (!wants_alignment(by.name) || !by.uncertainty || by.features.array_count() > 0) return;
  Rows places;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (made.uncertainties[i].out_of_distribution.may_be_two) places.push_back(i);
  if (places.empty()) return;
  for (const std::size_t i : places)
    made.uncertainties[i].out_of_distribution.reason = "two bodies, not separable";
  const Halves halves = halves_of(by, data, rows, places);
  if (halves.places.empty()) return;
  const Rows all = all_rows(halves.data.size());
  const Matrix aligned = by.align(halves.data, all, true);
  SoftMaps soft_halves;
  const Matrix maps =
      by.model->predict(by.inputs(halves.data, all, aligned), soft ? &soft_halves : nullptr);
  const Matrix predictors = predictors_of(maps, by.scene, halves.data, all, by.features.inputs);
  const auto judged = by.uncertainty->detector.judge(aligned, halves.data, all);
  for (std::size_t k = 0; k < halves.places.size(); ++k) {
    const std::size_t place = halves.places[k];
    PredictionUncertainty& stated = made.uncertainties[place];
    for (std::size_t i = 2 * k; i < 2 * k + 2; ++i)
      stated.bodies.push_back(
          body_of(maps.row(i), by.scene, by.uncertainty->lateral(predictors.row(i))));
    if (std::isnan(stated.bodies[0].z_m) || std::isnan(stated.bodies[1].z_m)) {
      stated.bodies.clear();
      continue;
    }
    compose(maps.row(2 * k), maps.row(2 * k + 1), by.scene, made.maps.row(place));
    if (soft) compose(soft_halves, k, *soft, place);
    stated.lateral_interval_90_m = stated.bodies[0].lateral_interval_90_m;
    stated.note = antennas ? "two bodies: range profile alone" : "two bodies";
    stated.out_of_distribution.reason.clear(), stated.out_of_distribution.details.clear();
  }
}

}  // namespace echofuse::recon
