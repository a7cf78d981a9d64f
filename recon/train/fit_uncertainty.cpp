// SPDX-License-Identifier: MIT
#include "recon/train/fit_uncertainty.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "drivers/util/console.hpp"
#include "recon/data/response_conversion.hpp"
#include "recon/metrics/metrics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t noise_stream = 0x6e6f6973;  // "nois" in ASCII
constexpr std::uint64_t fold_stream = 0x756e6366;   // "uncf" in ASCII
constexpr std::size_t worse_copies = 3;
// If there are at least this many records, a model trained on half of them is nearly as good as a
// model trained on all records.
constexpr std::size_t enough_for_halves = 2000;
// Log10 of the smallest fraction of photons that is kept.
constexpr double fewest_photons_log10 = -2.5;
// Range of the log10 of the added radar noise, relative to the peak of the profile.
constexpr double min_noise_log10 = -2, max_noise_log10 = -0.3;

std::vector<double> lateral_errors(const Matrix& maps, const Matrix& truth,
                                   const SceneModel& scene) {
  std::vector<double> out;
  for (std::size_t i = 0; i < maps.rows; ++i)
    out.push_back(lateral_error(maps.row(i), truth.row(i), scene));
  return out;
}

// Learns how much the errors increase if the radar profile was converted from a wider response
// (WiderRadars).
void learn_converted(LateralError& lateral, const Estimator& model, const Dataset& data,
                     const Rows& usual, const std::vector<HeldOut>& assessed, Rng& rng) {
  // Maximum number of records per model. If 500 records are used, the fraction of errors within the
  // interval has a standard error of .013.
  constexpr std::size_t max_records = 500;
  const Inputs inputs = model.features.inputs;
  const WiderRadars wider(data, usual, inputs);
  for (std::size_t k = 0; k < wider.size(); ++k) {
    Matrix predictors;
    std::vector<double> errors;
    for (const HeldOut& part : assessed) {
      Rows some = part.rows;
      some.resize(std::min(some.size(), max_records));
      const Dataset records = wider.imitated(k, data, some, rng);
      const Rows all = all_rows(some.size());
      const Matrix made = part.model.maps(records, all);
      append_rows(predictors, predictors_of(made, model.scene, records, all, inputs));
      const auto more = lateral_errors(made, records.depth(), model.scene);
      errors.insert(errors.end(), more.begin(), more.end());
    }
    lateral.add_converted(wider.times_wider(k), predictors, errors);
  }
}

}  // namespace

void degrade(Dataset& data, Rng& rng) {
  std::uniform_real_distribution<double> photons(fewest_photons_log10, 0);
  std::uniform_real_distribution<double> noise(min_noise_log10, max_noise_log10);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < data.size(); ++i) {
    const double share = std::pow(10, photons(rng));
    float level = 0;
    for (Column& column : data.columns) {
      const auto row = column.row(i);
      if (column.noise == Noise::none || row.empty()) continue;
      if (column.noise == Noise::counts) {
        // Counts are rounded, because the counts of a calibrated run are not integers.
        for (float& v : row)
          v = static_cast<float>(
              std::binomial_distribution<long>(std::max(std::lround(v), 0L), share)(rng));
        continue;
      }
      if (column.noise == Noise::power) level = static_cast<float>(std::pow(10, noise(rng)));
      // A bin of lags begins with the real lag 0, which is the mean power of the antennas; the
      // other lags are complex.
      const std::size_t values = column.axis.values_per_bin();
      float top = 0;
      for (std::size_t k = 0; k < row.size(); k += values) top = std::max(top, row[k]);
      for (std::size_t k = 0; k < row.size(); ++k)
        row[k] +=
            level * top * (k % values == 0 ? 1 : std::numbers::sqrt2_v<float> / 2) * normal(rng);
    }
  }
}

bool has_enough_records(const Split& split) {
  return split.train.size() + split.validation.size() >= min_cross_fitted;
}

UncertaintyModel fit_uncertainty(const Estimator& model, const Dataset& data, const Matrix& views,
                                 const Rows& usual, const std::vector<HeldOut>& assessed,
                                 std::uint64_t seed) {
  UncertaintyModel out;
  const Inputs inputs = model.features.inputs;
  out.detector =
      OutOfDistributionDetector(model.alignment, data, views, usual, inputs, model.scene, seed);
  Rng rng = make_rng(seed, noise_stream);
  Matrix predictors, maps, truth(0, data.depth().cols);
  SoftMaps soft;
  std::vector<double> errors;
  // Predicts the maps of all held-out records: first those of the unmodified records, then those of
  // degraded copies.
  for (std::size_t copy = 0; copy <= worse_copies; ++copy)
    for (const HeldOut& part : assessed) {
      Dataset records = part_of(data, part.rows);
      const Rows all = all_rows(part.rows.size());
      const bool plain = copy == 0;
      if (!plain) degrade(records, rng);
      SoftMaps own;
      const Matrix made = part.model.maps(records, all, part.model.views(records, all, false),
                                          plain ? &own : nullptr);
      append_rows(predictors, predictors_of(made, model.scene, records, all, inputs));
      const auto more = lateral_errors(made, records.depth(), model.scene);
      errors.insert(errors.end(), more.begin(), more.end());
      if (!plain) continue;
      append_rows(maps, made), append_rows(truth, records.depth());
      append_rows(soft.foreground_probability, own.foreground_probability);
      append_rows(soft.depth, own.depth);
    }
  out.lateral.fit(predictors, errors, maps.rows);
  learn_converted(out.lateral, model, data, usual, assessed, rng);
  std::vector<double> lateral_interval_90_m;
  for (std::size_t i = 0; i < maps.rows; ++i)
    lateral_interval_90_m.push_back(out.lateral(predictors.row(i)));
  out.pixels.fit(soft_of(std::move(soft), maps, model.scene, lateral_interval_90_m), truth,
                 model.scene);
  return out;
}

std::optional<UncertaintyModel> fit_uncertainty(const Estimator& model, const Dataset& data,
                                                const Matrix& views, const Split& split,
                                                const SplitOptions& options,
                                                const std::function<Estimator(const Split&)>& fit,
                                                std::size_t enough_validation) {
  const std::uint64_t seed = options.seed;
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  if (split.validation.size() >= enough_validation)
    return fit_uncertainty(model, data, views, rows, {{model, split.validation}}, seed);
  std::sort(rows.begin(), rows.end());
  const bool few = rows.size() < enough_for_halves;
  std::vector<Split> folds = make_folds(rows, few ? 4 : 2, options, fold_stream);
  if (!few) folds.resize(1);  // the errors of one half of the records are sufficient
  std::vector<Estimator> models;
  std::vector<HeldOut> assessed;
  models.reserve(folds.size());
  for (const Split& fold : folds) {
    Split part;
    for (const std::size_t row : fold.train)
      (std::binary_search(split.validation.begin(), split.validation.end(), row) ? part.validation
                                                                                 : part.train)
          .push_back(row);
    std::sort(part.train.begin(), part.train.end());
    models.push_back(fit(part));
    if (interrupted()) return {};
    assessed.push_back({models.back(), fold.test});
  }
  return fit_uncertainty(model, data, views, rows, assessed, seed);
}

}  // namespace echofuse::recon
