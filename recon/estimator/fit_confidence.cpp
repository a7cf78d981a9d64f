// SPDX-License-Identifier: MIT
#include "recon/estimator/fit_confidence.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "recon/estimator/answer.hpp"
#include "recon/maps/metrics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t noise_stream = 0x6e6f6973;  // "nois"
constexpr std::size_t worse_copies = 3;
constexpr double fewest_photons_log10 = -2.5;  // share of a worse copy's photons
constexpr double least_noise_log10 = -2, most_noise_log10 = -0.3;  // radar, against its peak

// The rows of a data set as one of their own.
Dataset part_of(const Dataset& data, const Rows& rows) {
  Dataset out;
  out.spd_axis = data.spd_axis, out.radar_axis = data.radar_axis;
  out.spd = take_rows(data.spd, rows), out.radar = take_rows(data.radar, rows);
  out.depth = take_rows(data.depth, rows);
  for (const std::size_t row : rows) out.valid.push_back(data.valid[row]);
  return out;
}

std::vector<double> lateral_errors(const Matrix& maps, const Matrix& truth, const Scene& scene) {
  std::vector<double> out;
  for (std::size_t i = 0; i < maps.rows; ++i)
    out.push_back(lateral_error(maps.row(i), truth.row(i), scene));
  return out;
}

}  // namespace

void make_worse(Dataset& data, Rng& rng) {
  std::uniform_real_distribution<double> photons(fewest_photons_log10, 0);
  std::uniform_real_distribution<double> noise(least_noise_log10, most_noise_log10);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < data.size(); ++i) {
    const double share = std::pow(10, photons(rng));
    for (float& v : data.spd.row(i))  // counts of a calibrated run are not whole
      v = static_cast<float>(
          std::binomial_distribution<long>(std::max(std::lround(v), 0L), share)(rng));
    const auto power = data.radar.row(i);
    if (power.empty()) continue;
    const float deviation = *std::max_element(power.begin(), power.end()) *
                            static_cast<float>(std::pow(10, noise(rng)));
    for (float& v : power) v += deviation * normal(rng);
  }
}

bool can_judge(const Split& split) {
  return split.train.size() >= Novelty::least_records &&
         split.validation.size() >= LateralError::least_records;
}

Confidence fit_confidence(const TrainedModel& model, const Dataset& data, const Split& split,
                          std::uint64_t seed) {
  Confidence out;
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  out.novelty = Novelty(data, rows, model.features.inputs, seed);
  Rng rng = make_rng(seed, noise_stream);
  const Dataset plain = part_of(data, split.validation);
  const Rows all = all_rows(plain.size());
  const Matrix maps = model.predict(plain, all);
  Matrix signs = signs_of(model, plain, all, maps);
  std::vector<double> errors = lateral_errors(maps, plain.depth, model.scene);
  for (std::size_t copy = 0; copy < worse_copies; ++copy) {
    Dataset worse = plain;
    make_worse(worse, rng);
    const Matrix worse_maps = model.predict(worse, all);
    const Matrix more = signs_of(model, worse, all, worse_maps);
    for (const std::size_t i : all) signs.add_row(more.row(i));
    const auto worse_errors = lateral_errors(worse_maps, plain.depth, model.scene);
    errors.insert(errors.end(), worse_errors.begin(), worse_errors.end());
  }
  out.lateral.fit(signs, errors, plain.size());
  std::vector<double> lateral_90_m;
  for (const std::size_t i : all) lateral_90_m.push_back(out.lateral(signs.row(i)));
  out.pixels.fit(soft_maps(model, plain, all, maps, lateral_90_m), plain.depth, model.scene);
  return out;
}

}  // namespace echofuse::recon
