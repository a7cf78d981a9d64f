// SPDX-License-Identifier: MIT
#include <algorithm>
#include <cmath>
#include <optional>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/method/method.hpp"
#include "recon/method/rotation.hpp"
#include "recon/trust/out_of_distribution.hpp"

namespace echofuse::recon {
namespace {

// Minimum lateral distance of two bodies, and maximum number of attempts to sample two such bodies.
constexpr double min_apart_m = 0.4;
constexpr int max_tries = 20;
// "pair" and "turn" in ASCII
constexpr std::uint64_t pair_stream = 0x70616972, rotation_stream = 0x7475726e;
constexpr std::size_t max_pairs = 96'000, pairs_a_record = 32;
constexpr std::size_t max_rotated = 48'000, rotated_per_record = 16;
constexpr std::size_t batch = 256, draws_a_record = 350, max_draws = 2'000'000;
constexpr double rate = 4e-3;  // learning rate

}  // namespace

Classifier learn_two_bodies(const Alignment& alignment, const Features& sensors,
                            const Dataset& data, const Matrix& views, const Rows& rows,
                            const SceneModel& scene, std::uint64_t seed) {
  const SeenBodies known = bodies_in(views, data.depth(), rows, scene.background, scene.grid);
  const std::size_t bodies = known.rows.size();
  if (bodies < 2) return {};
  const Matrix observations = observe(data, known.rows, sensors), no_lags;
  std::optional<RotatedBodies> rotated;
  if (alignment.turns_bodies() && alignment.array_features() == 0) {
    rotated.emplace(alignment, views, data.radar(), no_lags, known.rows, known.places);
    if (!rotated->rotates()) rotated.reset();
  }

  const auto views_of = [&](const std::vector<BodySum>& sums) {
    return summed_views(sums, alignment, observations, data.radar(), known,
                        rotated ? &*rotated : nullptr);
  };
  const auto any = [&](Rng& rng) {
    return std::uniform_int_distribution<std::size_t>(0, bodies - 1)(rng);
  };
  const auto side_m = [&](const BodySource& body) {
    const auto tangent = double{known.places[body.as].tangent};
    return double{views.row(known.rows[body.k]).back()} * tangent / std::hypot(1.0, tangent);
  };
  Rng pair_rng = make_rng(seed, pair_stream), rotation_rng = make_rng(seed, rotation_stream);
  std::vector<BodySum> pairs(std::min(max_pairs, pairs_a_record * bodies)),
      singles(rotated ? std::min(max_rotated, rotated_per_record * bodies) : 0);
  for (auto& pair : pairs)
    for (int tries = 0; tries < max_tries; ++tries) {
      const std::size_t a = any(pair_rng), b = any(pair_rng);
      const std::size_t as_a = rotated ? any(pair_rng) : a, as_b = rotated ? any(pair_rng) : b;
      pair = {{a, as_a}, {b, as_b}};
      if (std::abs(side_m(pair[0]) - side_m(pair[1])) >= min_apart_m) break;
    }
  for (auto& single : singles) {
    const std::size_t k = any(rotation_rng);
    single = {{k, any(rotation_rng)}};
  }
  Matrix ones(0, alignment.size());
  for (const std::size_t row : known.rows) ones.add_row(views.row(row).last(alignment.size()));
  append_rows(ones, views_of(singles));
  Classifier out;
  out.fit(ones, views_of(pairs),
          {{128, 64}, std::min(max_draws, draws_a_record * bodies) / batch + 1, batch, rate, seed});
  return out;
}

}  // namespace echofuse::recon
