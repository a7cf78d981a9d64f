// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/method/method.hpp"
#include "recon/method/rotation.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/trust/out_of_distribution.hpp"

namespace echofuse::recon {
namespace {

constexpr double min_apart_m = 0.4;  // minimum lateral distance of two bodies, m
// Maximum number of attempts to sample two bodies that are far enough apart.
constexpr int max_tries = 20;
// "pair" and "turn" in ASCII
constexpr std::uint64_t pair_stream = 0x70616972, rotation_stream = 0x7475726e;
constexpr std::size_t max_pairs = 96'000, pairs_a_record = 32;
constexpr std::size_t max_rotated = 48'000, rotated_per_record = 16;
const std::vector<std::size_t> hidden = {128, 64};
constexpr std::size_t batch = 256, draws_a_record = 350, max_draws = 2'000'000;
constexpr double learning_rate = 4e-3;

// Records with a body at a known position, one record per row.
struct KnownBodies {
  Matrix observations, views, radar;  // the views do not contain the correlation
  std::vector<Place> places;
};

KnownBodies known_bodies(const Alignment& alignment, const Features& sensors, const Dataset& data,
                         const Rows& rows, const SceneModel& scene) {
  const Layout layout = sensors.layout();
  KnownBodies out{
      Matrix(0, layout.inputs()), Matrix(0, alignment.size()), Matrix(0, layout.radar.count), {}};
  const Matrix all = observe(data, rows, sensors);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<float> view(alignment.size());
    align(all.row(i), alignment, view);
    const auto place = place_of(data.depth().row(rows[i]), scene.background, scene.grid);
    if (!shows_body(view) || !place) continue;
    out.observations.add_row(all.row(i)), out.views.add_row(view), out.places.push_back(*place);
    out.radar.add_row(layout.parts(all.row(i)).power);
  }
  return out;
}

struct BodySource {
  std::size_t k, as;  // record of the body, and record that provides its azimuth
};
using BodySum = std::vector<BodySource>;  // bodies that are summed to form one record

double side_m(const KnownBodies& known, const BodySource& body) {
  const auto tangent = double{known.places[body.as].tangent};
  return double{known.views.row(body.k).back()} * tangent / std::hypot(1.0, tangent);
}

std::size_t any_row(std::size_t rows, Rng& rng) {
  return std::uniform_int_distribution<std::size_t>(0, rows - 1)(rng);
}

}  // namespace

Classifier learn_two_bodies(const Alignment& alignment, const Features& sensors,
                            const Dataset& data, const Rows& rows, const SceneModel& scene,
                            std::uint64_t seed) {
  Classifier out;
  const KnownBodies known = known_bodies(alignment, sensors, data, rows, scene);
  const Matrix &observations = known.observations, &views = known.views, &radar = known.radar;
  const std::vector<Place>& places = known.places;
  const Rows bodies = all_rows(views.rows);
  if (bodies.size() < 2) return out;
  const Matrix no_lags;
  std::optional<RotatedBodies> rotated;
  if (alignment.profile_points() > 0 && alignment.array_features() == 0) {
    rotated.emplace(alignment, views, radar, no_lags, bodies, places);
    if (!rotated->rotates()) rotated.reset();
  }

  const auto any = [&](Rng& rng) { return any_row(bodies.size(), rng); };
  // Subtracts the background from all but one body, because a real record contains it only once.
  const std::vector<float>& background = alignment.background();
  const auto add_up = [&](std::span<const BodySource> some, std::span<float> view) {
    const auto first = observations.row(some[0].k);
    std::vector<float> sum(first.begin(), first.end());
    for (const BodySource& body : some.subspan(1))
      for (std::size_t c = 0; c < sum.size(); ++c)
        sum[c] = sum[c] + observations.row(body.k)[c] - background[c];
    align(sum, alignment, view);
    if (!rotated || !shows_body(view)) return;
    std::vector<Alignment::MovedProfile> moved;
    for (const auto& [k, as] : some) moved.push_back({radar.row(k), rotated->farther_m(k, as)});
    alignment.add_profiles(moved, view);
  };
  const auto views_of = [&](const std::vector<BodySum>& records) {
    Matrix made(records.size(), views.cols);
    for_each_part(made.rows, [&](std::size_t i) { add_up(records[i], made.row(i)); });
    return made;
  };

  Rng pair_rng = make_rng(seed, pair_stream), rotation_rng = make_rng(seed, rotation_stream);
  std::vector<BodySum> pairs(std::min(max_pairs, pairs_a_record * views.rows)), singles;
  for (auto& pair : pairs) {
    int tries = 0;
    do {
      const std::size_t a = any(pair_rng), b = any(pair_rng);
      const std::size_t as_a = rotated ? any(pair_rng) : a, as_b = rotated ? any(pair_rng) : b;
      pair = {{a, as_a}, {b, as_b}};
    } while (std::abs(side_m(known, pair[0]) - side_m(known, pair[1])) < min_apart_m &&
             ++tries < max_tries);
  }
  if (rotated) singles.resize(std::min(max_rotated, rotated_per_record * views.rows));
  for (auto& single : singles) {
    const std::size_t k = any(rotation_rng);
    single = {{k, any(rotation_rng)}};
  }
  Matrix ones = views;
  append_rows(ones, views_of(singles));
  out.fit(ones, views_of(pairs),
          {hidden, std::min(max_draws, draws_a_record * views.rows) / batch + 1, batch,
           learning_rate, seed});
  return out;
}

}  // namespace echofuse::recon
