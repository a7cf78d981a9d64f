// SPDX-License-Identifier: MIT
#include "recon/trust/two_bodies.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/method/method.hpp"
#include "recon/method/turned.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// Each of the two bodies is as deep as its outstretched arms.
constexpr double least_apart_m = 0.4;  // sideways
constexpr int most_tries = 20;         // tries to draw two bodies that are so far apart
constexpr std::uint64_t pair_stream = 0x70616972, turn_stream = 0x7475726e;  // "pair", "turn"
constexpr std::size_t most_pairs = 96'000, pairs_a_record = 32;
constexpr std::size_t most_turned = 48'000, turned_a_record = 16;
const std::vector<std::size_t> hidden = {128, 64};
constexpr std::size_t batch = 256, draws_a_record = 350, most_draws = 2'000'000;
constexpr double learning_rate = 4e-3;
constexpr double nobody = -30;                // log odds
constexpr double background_quantile = 0.05;  // quantile of the radar's power, without an alignment

}  // namespace

void TwoBodies::use(const Features& of_model, const Alignment& alignment) {
  spd_bins_ = of_model.spd_count(), profile_ = of_model.radar_count();
  alignment_ = spd_bins_ > 0 ? alignment : Alignment{};
}

std::vector<float> TwoBodies::describe(std::span<const float> raw_inputs) const {
  std::vector<float> out;
  if (alignment_.known()) {
    out.resize(alignment_.size());
    align(raw_inputs, alignment_, out);
  } else {
    const auto radar = radar_of(raw_inputs);
    out.assign(radar.begin(), radar.end());
    share_out(out);
  }
  return out;
}

void TwoBodies::learn(const Matrix& raw_inputs, const Rows& rows,
                      const std::vector<std::optional<Place>>& places, std::uint64_t seed) {
  Matrix ones, pairs;
  classifier_ = {};
  // `seen` are the records with a body, and `known` is where the body stands.
  Rows seen, usable;
  std::vector<Place> known;
  for (const std::size_t row : rows) {
    const auto one = describe(raw_inputs.row(row));
    if (alignment_.known() && !shows_body(one)) continue;
    ones.cols = one.size();
    ones.add_row(one);
    seen.push_back(row);
    if (places[row]) usable.push_back(seen.size() - 1), known.push_back(*places[row]);
  }
  if (seen.size() < 2) return;
  // A sum holds the background once, as a record does.
  const std::vector<float> background =
      alignment_.known() ? alignment_.background()
                         : column_quantile(raw_inputs, seen, background_quantile);
  if (usable.size() < 2) usable.clear();
  std::optional<TurnedBodies> turned;
  Matrix inputs, radar;
  const Matrix no_array;
  if (alignment_.profile_points() > 0 && alignment_.array_features() == 0 && !usable.empty()) {
    inputs = ones;  // `ones` grows below
    radar = Matrix(0, profile_);
    for (const std::size_t row : seen) radar.add_row(radar_of(raw_inputs.row(row)));
    turned.emplace(alignment_, inputs, radar, no_array, usable, known);
    if (!turned->turns()) turned.reset();
  }
  const Rows everybody = usable.empty() ? all_rows(seen.size()) : usable;
  const auto any = [&](Rng& rng) {
    return std::uniform_int_distribution<std::size_t>(0, everybody.size() - 1)(rng);
  };
  // This is where body k would stand in the azimuth of body `as`.
  const auto side_m = [&](std::size_t k, std::size_t as) {
    const auto tangent = double{known[as].tangent};
    const double range_m =
        alignment_.known() ? double{ones.row(usable[k]).back()} : double{known[k].depth_m};
    return range_m * tangent / std::hypot(1.0, tangent);
  };
  struct Pair {
    std::size_t a, b, as_a, as_b;  // each body, and the one whose azimuth it takes
  };
  std::vector<Pair> drawn(std::min(most_pairs, pairs_a_record * seen.size()));
  Rng pair_rng = make_rng(seed, pair_stream);
  for (auto& [a, b, as_a, as_b] : drawn) {
    int tries = 0;
    do {
      a = any(pair_rng), b = any(pair_rng);
      as_a = turned ? any(pair_rng) : a, as_b = turned ? any(pair_rng) : b;
    } while (!usable.empty() && std::abs(side_m(a, as_a) - side_m(b, as_b)) < least_apart_m &&
             ++tries < most_tries);
  }
  pairs = Matrix(drawn.size(), ones.cols);
  for_each_part(pairs.rows, [&](std::size_t i) {
    const auto [a, b, as_a, as_b] = drawn[i];
    const auto first = raw_inputs.row(seen[everybody[a]]),
               second = raw_inputs.row(seen[everybody[b]]);
    std::vector<float> sum(first.size());
    for (std::size_t c = 0; c < sum.size(); ++c) sum[c] = first[c] + second[c] - background[c];
    const auto described = describe(sum);
    std::copy(described.begin(), described.end(), pairs.row(i).begin());
    if (!turned || !shows_body(described)) return;
    const std::array<Alignment::MovedProfile, 2> moved{
        {{radar_of(first), turned->farther_m(a, as_a)},
         {radar_of(second), turned->farther_m(b, as_b)}}};
    alignment_.add_profiles(moved, pairs.row(i));
  });
  if (turned) {
    const std::size_t plain = ones.rows, more = std::min(most_turned, turned_a_record * plain);
    ones.values.resize((plain + more) * ones.cols);
    ones.rows += more;
    Rng turn_rng = make_rng(seed, turn_stream);
    std::vector<std::array<std::size_t, 2>> turns(more);  // each body, and whose azimuth it takes
    for (auto& [k, as] : turns) k = any(turn_rng), as = any(turn_rng);
    for_each_part(more, [&](std::size_t i) {
      const auto [k, as] = turns[i];
      const auto out = ones.row(plain + i), from = ones.row(usable[k]);
      std::copy(from.begin(), from.end(), out.begin());
      const std::array<Alignment::MovedProfile, 1> moved{
          {{radar_of(raw_inputs.row(seen[usable[k]])), turned->farther_m(k, as)}}};
      alignment_.add_profiles(moved, out);
    });
  }
  classifier_.fit(ones, pairs,
                  {hidden, std::min(most_draws, draws_a_record * seen.size()) / batch + 1, batch,
                   learning_rate, seed});
}

double TwoBodies::operator()(std::span<const float> aligned, std::span<const float> power) const {
  if (!classifier_.known() || (alignment_.known() && !shows_body(aligned))) return nobody;
  if (alignment_.known()) return classifier_(aligned);
  std::vector<float> shares(power.begin(), power.end());
  share_out(shares);
  return classifier_(shares);
}

void TwoBodies::archive(Archive archive) {
  if (archive.part("known", classifier_.known()))
    classifier_.archive(archive, alignment_.known() ? alignment_.size() : profile_);
}

}  // namespace echofuse::recon
