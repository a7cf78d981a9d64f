// SPDX-License-Identifier: MIT
#include "recon/estimator/fit_uncertainty.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "recon/maps/metrics.hpp"
#include "recon/uncertainty/predictors.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t noise_stream = 0x6e6f6973;  // "nois"
constexpr std::size_t worse_copies = 3;
constexpr double fewest_photons_log10 = -2.5;  // share of a worse copy's photons
constexpr double least_noise_log10 = -2, most_noise_log10 = -0.3;  // radar, against its peak

std::vector<double> lateral_errors(const Matrix& maps, const Matrix& truth, const Scene& scene) {
  std::vector<double> out;
  for (std::size_t i = 0; i < maps.rows; ++i)
    out.push_back(lateral_error(maps.row(i), truth.row(i), scene));
  return out;
}

}  // namespace

void degrade(Dataset& data, Rng& rng) {
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

bool has_enough_records(const Split& split) {
  return split.train.size() >= OutOfDistributionDetector::least_records &&
         split.validation.size() >= LateralError::least_records;
}

UncertaintyModel fit_uncertainty(const TrainedModel& model, const Dataset& data,
                                 const Matrix& aligned, const Split& split, std::uint64_t seed) {
  UncertaintyModel out;
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  out.detector =
      OutOfDistributionDetector(model.alignment, data, aligned, rows, model.features.inputs, seed);
  Rng rng = make_rng(seed, noise_stream);
  const Dataset plain = part_of(data, split.validation);
  const Rows all = all_rows(plain.size());
  SoftMaps soft;
  const Matrix maps =
      model.model->predict(model.inputs(plain, all, take_rows(aligned, split.validation)), &soft);
  const auto predictors_of_maps = [&](const Matrix& made, const Dataset& of) {
    return predictors_of(made, model.scene, of, all, model.features.inputs);
  };
  Matrix predictors = predictors_of_maps(maps, plain);
  std::vector<double> errors = lateral_errors(maps, plain.depth, model.scene);
  for (std::size_t copy = 0; copy < worse_copies; ++copy) {
    Dataset worse = plain;
    degrade(worse, rng);
    const Matrix worse_maps = model.predict(worse, all);
    const Matrix more = predictors_of_maps(worse_maps, worse);
    for (const std::size_t i : all) predictors.add_row(more.row(i));
    const auto worse_errors = lateral_errors(worse_maps, plain.depth, model.scene);
    errors.insert(errors.end(), worse_errors.begin(), worse_errors.end());
  }
  out.lateral.fit(predictors, errors, plain.size());
  std::vector<double> lateral_interval_90_m;
  for (const std::size_t i : all) lateral_interval_90_m.push_back(out.lateral(predictors.row(i)));
  out.pixels.fit(soft_of(std::move(soft), maps, model.scene, lateral_interval_90_m), plain.depth,
                 model.scene);
  return out;
}

}  // namespace echofuse::recon
