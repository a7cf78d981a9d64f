// SPDX-License-Identifier: MIT
#include "recon/estimator/separate.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "recon/maps/people.hpp"
#include "recon/models/body/split_bodies.hpp"
#include "recon/uncertainty/predictors.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t sum_stream = 0x73756d73;  // "sums"
constexpr std::size_t most_draws = 20'000;
constexpr double least_apart_m = 0.4;  // sideways

// Records of one body each: rows 2 k and 2 k + 1 are the bodies of the record places[k].
struct Halves {
  Dataset data;
  Rows places;
  std::vector<double> apart_m;  // in range
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
    out.places.push_back(place);
    out.apart_m.push_back(split->parts[1].range_m - split->parts[0].range_m);
    found.push_back(std::move(*split));
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

bool takes_apart(const TrainedModel& model) {
  return wants_alignment(model.name) && model.features.array_count() == 0;
}

// Pairs of rows whose bodies stand apart, as sums; the nearer body's place comes first.
struct Sums {
  Dataset data;
  std::vector<std::array<Place, 2>> places;
};

Sums sums_of(const TrainedModel& model, const Dataset& data, const Rows& rows, std::size_t most,
             std::uint64_t seed) {
  Rows seen;
  std::vector<Place> places;
  for (const std::size_t row : rows)
    if (const auto place =
            data.label[row] == two_people_label
                ? std::nullopt
                : place_of(data.depth.row(row), model.scene.background, model.scene.grid))
      seen.push_back(row), places.push_back(*place);
  Sums out;
  Rows first, second;
  if (!seen.empty()) {
    Rng rng = make_rng(seed, sum_stream);
    std::uniform_int_distribution<std::size_t> any(0, seen.size() - 1);
    for (std::size_t draw = 0; draw < most_draws && first.size() < most; ++draw) {
      const std::size_t a = any(rng), b = any(rng);
      const auto x_m = [&](std::size_t i) { return places[i].tangent * places[i].depth_m; };
      if (double{places[b].depth_m - places[a].depth_m} < model.alignment.resolution_m() ||
          std::abs(x_m(a) - x_m(b)) < least_apart_m)
        continue;
      first.push_back(seen[a]), second.push_back(seen[b]);
      out.places.push_back({places[a], places[b]});
    }
  }
  out.data = part_of(data, first);
  const std::vector<float> background = model.alignment.background();
  const std::size_t bins = model.features.spd_count();
  for (std::size_t i = 0; i < first.size(); ++i) {
    const auto spd = out.data.spd.row(i), radar = out.data.radar.row(i);
    for (std::size_t c = 0; c < spd.size(); ++c)
      spd[c] += data.spd.row(second[i])[c] - background[c];
    for (std::size_t c = 0; c < radar.size(); ++c)
      radar[c] += data.radar.row(second[i])[c] - background[bins + c];
  }
  return out;
}

}  // namespace

std::vector<SeparatedError::Sum> errors_of_separated(const TrainedModel& model,
                                                     const LateralError& lateral,
                                                     const Dataset& data, const Rows& rows,
                                                     std::size_t most, std::uint64_t seed) {
  std::vector<SeparatedError::Sum> out;
  if (!takes_apart(model)) return out;
  const Sums sums = sums_of(model, data, rows, most, seed);
  const Rows every = all_rows(sums.places.size());
  const Halves halves = halves_of(model, sums.data, every, every);
  if (halves.places.empty()) return out;
  const Rows all = all_rows(halves.data.size());
  const Matrix maps = model.model->predict(
      model.inputs(halves.data, all, model.align(halves.data, all, true)), nullptr);
  const Matrix predictors =
      predictors_of(maps, model.scene, halves.data, all, model.features.inputs);
  for (std::size_t i = 0; i < maps.rows; ++i) {
    const auto found = place_of(maps.row(i), model.scene.background, model.scene.grid);
    const double interval_m = lateral(predictors.row(i));
    if (!found || std::isnan(interval_m)) continue;
    const Place& truth = sums.places[halves.places[i / 2]][i % 2];
    const auto off = double{found->tangent - truth.tangent};
    out.push_back({halves.apart_m[i / 2], std::abs(off) * double{truth.depth_m} / interval_m});
  }
  return out;
}

void separate_bodies(const TrainedModel& model, const Dataset& data, const Rows& rows,
                     Prediction& made, SoftMaps* soft) {
  const bool antennas = model.features.array_count() > 0;
  const TrainedModel& by =
      antennas && model.fallback && both_sensors(model.fallback->features.inputs) ? *model.fallback
                                                                                  : model;
  if (!takes_apart(by) || !by.uncertainty) return;
  Rows places;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (const OutOfDistributionScore& score = made.uncertainties[i].out_of_distribution;
        score.may_be_two && score.reason.find("antennas") == std::string::npos)
      places.push_back(i);
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
  require_finite(maps);
  const Matrix predictors = predictors_of(maps, by.scene, halves.data, all, by.features.inputs);
  for (std::size_t k = 0; k < halves.places.size(); ++k) {
    const std::size_t place = halves.places[k];
    PredictionUncertainty& stated = made.uncertainties[place];
    for (std::size_t i = 2 * k; i < 2 * k + 2; ++i)
      stated.bodies.push_back(body_of(maps.row(i), by.scene,
                                      by.uncertainty->separated(halves.apart_m[k]) *
                                          by.uncertainty->lateral(predictors.row(i))));
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
