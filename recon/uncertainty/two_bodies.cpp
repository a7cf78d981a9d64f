// SPDX-License-Identifier: MIT
#include "recon/uncertainty/two_bodies.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/models/body/turned.hpp"
#include "recon/numbers/matrix_file.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// Two bodies, each as deep as its outstretched arms.
constexpr AlignmentWindow window{
    .histogram_m = 1.4, .profile_from_m = -1.4, .profile_to_m = 1.7, .body_m = 1.3};
constexpr double least_apart_m = 0.4;  // sideways
constexpr int most_tries = 20;         // to draw two bodies that are
constexpr std::uint64_t pair_stream = 0x70616972, turn_stream = 0x7475726e;  // "pair", "turn"
constexpr std::uint64_t light_stream = 0x6c696768;                           // "ligh"
constexpr double without_light = 0.3;                                        // share of examples
constexpr std::size_t most_pairs = 96'000, pairs_a_record = 32;
constexpr std::size_t most_turned = 48'000, turned_a_record = 16;
const std::vector<std::size_t> hidden = {128, 64};
constexpr std::size_t batch = 256, draws_a_record = 500, most_draws = 3'000'000;
constexpr double learning_rate = 4e-3;
constexpr double nobody = -30;                // log odds
constexpr double background_quantile = 0.05;  // of the radar's power, without an alignment

template <class Light>
Matrix with_light(const Matrix& described, const std::vector<Light>& lights, Rng& rng) {
  std::bernoulli_distribution forgotten(without_light);
  Matrix out(described.rows, described.cols + std::tuple_size_v<Light>);
  for (std::size_t i = 0; i < out.rows; ++i) {
    const auto from = described.row(i);
    const auto to = out.row(i);
    std::copy(from.begin(), from.end(), to.begin());
    if (!forgotten(rng))
      std::copy(lights[i].begin(), lights[i].end(), to.last(lights[i].size()).begin());
  }
  return out;
}

}  // namespace

void TwoBodies::use(const Features& of_model, const Alignment& alignment) {
  spd_bins_ = of_model.spd_count(), profile_ = of_model.radar_count();
  alignment_ = spd_bins_ > 0 ? alignment.through(window) : Alignment{};
  by_light_ = spd_bins_ > 0 && alignment.gains() == Gains::stable;
}

TwoBodies::Light TwoBodies::light_of(std::span<const float> raw_inputs,
                                     std::span<const float> described) const {
  if (!by_light_ || !shows_body(described)) return {};
  std::vector<float> clicks, power;
  alignment_.subtract_background(raw_inputs, clicks, power);
  const auto range_m = double{described.back()};
  const AlignmentRanges spd = alignment_.spd_ranges();
  double sum = 0;
  for (std::size_t i = 0; i < clicks.size(); ++i)
    if (std::abs(spd.first_m + static_cast<double>(i) * spd.step_m - range_m) <= window.body_m)
      sum += double{clicks[i]};
  if (!(sum > 0)) return {};
  return {static_cast<float>(std::log(sum * range_m * range_m) - light_level_), 1};
}

std::vector<float> TwoBodies::describe(std::span<const float> raw_inputs) const {
  std::vector<float> out;
  if (alignment_.known()) {
    out.resize(alignment_.size());
    alignment_(raw_inputs, out);
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
  std::vector<Light> of_ones, of_pairs;
  classifier_ = {}, light_level_ = 0;
  // Records with a body, and where it is.
  Rows seen, usable;
  std::vector<Place> known;
  for (const std::size_t row : rows) {
    const auto one = describe(raw_inputs.row(row));
    if (alignment_.known() && !shows_body(one)) continue;
    ones.cols = one.size();
    ones.add_row(one);
    of_ones.push_back(light_of(raw_inputs.row(row), one));
    seen.push_back(row);
    if (places[row]) usable.push_back(seen.size() - 1), known.push_back(*places[row]);
  }
  if (seen.size() < 2) return;
  if (by_light_) {
    for (const Light& light : of_ones)
      light_level_ += double{light[0]} / static_cast<double>(of_ones.size());
    for (Light& light : of_ones) light[0] -= static_cast<float>(light_level_);
  }
  // A sum has it once, as a record has.
  const std::vector<float> background =
      alignment_.known() ? alignment_.background()
                         : column_quantile(raw_inputs, seen, background_quantile);
  if (usable.size() < 2) usable.clear();
  std::optional<TurnedBodies> turned;
  Matrix inputs, radar;
  const Matrix no_array;
  if (alignment_.profile_points() > 0 && alignment_.array_features() == 0 && !usable.empty()) {
    inputs = alignment_.with_correlations(ones);
    radar = Matrix(0, profile_);
    for (const std::size_t row : seen) radar.add_row(radar_of(raw_inputs.row(row)));
    turned.emplace(alignment_, inputs, radar, no_array, usable, known);
    if (!turned->turns()) turned.reset();
  }
  const Rows everybody = usable.empty() ? all_rows(seen.size()) : usable;
  const auto any = [&](Rng& rng) {
    return std::uniform_int_distribution<std::size_t>(0, everybody.size() - 1)(rng);
  };
  // As the body k would stand in the azimuth of the body `as`.
  const auto side_m = [&](std::size_t k, std::size_t as) {
    const auto tangent = double{known[as].tangent};
    const double range_m =
        alignment_.known() ? double{ones.row(usable[k]).back()} : double{known[k].depth_m};
    return range_m * tangent / std::hypot(1.0, tangent);
  };
  struct Pair {
    std::size_t a, b, as_a, as_b;  // each body, and the one in whose azimuth it stands
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
  of_pairs.resize(pairs.rows);
  for_each_part(pairs.rows, [&](std::size_t i) {
    const auto [a, b, as_a, as_b] = drawn[i];
    const auto first = raw_inputs.row(seen[everybody[a]]),
               second = raw_inputs.row(seen[everybody[b]]);
    std::vector<float> sum(first.size());
    for (std::size_t c = 0; c < sum.size(); ++c) sum[c] = first[c] + second[c] - background[c];
    const auto described = describe(sum);
    std::copy(described.begin(), described.end(), pairs.row(i).begin());
    of_pairs[i] = light_of(sum, described);
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
    of_ones.resize(ones.rows);
    Rng turn_rng = make_rng(seed, turn_stream);
    std::vector<std::array<std::size_t, 2>> turns(more);  // a body, and whose azimuth it gets
    for (auto& [k, as] : turns) k = any(turn_rng), as = any(turn_rng);
    for_each_part(more, [&](std::size_t i) {
      const auto [k, as] = turns[i];
      const auto out = ones.row(plain + i), from = ones.row(usable[k]);
      std::copy(from.begin(), from.end(), out.begin());
      of_ones[plain + i] = of_ones[usable[k]];
      const std::array<Alignment::MovedProfile, 1> moved{
          {{radar_of(raw_inputs.row(seen[usable[k]])), turned->farther_m(k, as)}}};
      alignment_.add_profiles(moved, out);
    });
  }
  if (by_light_) {
    Rng rng = make_rng(seed, light_stream);
    ones = with_light(ones, of_ones, rng), pairs = with_light(pairs, of_pairs, rng);
  }
  classifier_.fit(ones, pairs,
                  {hidden, std::min(most_draws, draws_a_record * seen.size()) / batch + 1, batch,
                   learning_rate, seed});
}

double TwoBodies::operator()(std::span<const float> raw_inputs, bool known_gains) const {
  auto described = describe(raw_inputs);
  if (!classifier_.known() || (alignment_.known() && !shows_body(described))) return nobody;
  if (by_light_) {
    const Light light = known_gains ? light_of(raw_inputs, described) : Light{};
    described.insert(described.end(), light.begin(), light.end());
  }
  return classifier_(described);
}

void TwoBodies::save(record::H5File& file, const std::string& group) const {
  if (!classifier_.known()) return;
  classifier_.save(file, group);
  if (by_light_) file.set(group, "light_level", light_level_);
}

void TwoBodies::load(const record::H5File& file, const std::string& group) {
  if (!file.has(group)) return;
  by_light_ = by_light_ && file.has_attribute(group, "light_level");  // else of a model of before
  if (by_light_) {
    light_level_ = file.get<double>(group, "light_level");
    require_sound(file, std::abs(light_level_) < 100, group + "@light_level", "from -100 to 100");
  }
  classifier_.load(file, group,
                   (alignment_.known() ? alignment_.size() : profile_) +
                       (by_light_ ? std::tuple_size_v<Light> : 0));
}

}  // namespace echofuse::recon
