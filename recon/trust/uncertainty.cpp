// SPDX-License-Identifier: MIT
#include "recon/trust/uncertainty.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "recon/metrics/metrics.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double smallest_error_m = 3e-3;  // smaller errors are replaced by this value
constexpr double penalty = 1e-3;
constexpr std::size_t folds = 5;

// Returns the number of clicks above the background, divided by the standard deviation of the
// number of all clicks.
float significance(std::span<const float> counts) {
  std::vector<float> sorted(counts.begin(), counts.end());
  const float level = quantile(sorted, 0.5);
  double above = 0, all = 0;
  for (const float v : counts) above += double{v - level}, all += double{v};
  return static_cast<float>(std::max(above, 0.0) / std::sqrt(all + 1));
}

// Returns the factor below which 90 % of new ratios lie (conformal prediction).
double factor_of(std::vector<double> ratios) {
  std::sort(ratios.begin(), ratios.end());
  const auto rank = static_cast<std::size_t>(
      std::ceil(LateralError::share_within * static_cast<double>(ratios.size() + 1)));
  return ratios[std::min(rank, ratios.size()) - 1];
}

// Returns the 90 % quantile of the lateral error that results from the run's range error. Returns 0
// if the run does not include the baseline, or if the model does not rely on the two ranges alone
// to distinguish left and right.
double range_error_m(const Dataset& data, std::size_t row, Inputs inputs,
                     std::span<const float> map, const SceneModel& scene) {
  // 95 % quantile of the normal distribution, because each tail contains 5 %
  constexpr double deviations_90 = 1.645;
  if (data.sources.empty() || !side_by_ranges(data, inputs)) return 0;
  const Source& run = data.sources[data.source_of(row)];
  const BodyPlace body = body_place(map, scene);
  const double baseline_m = run.mounting.baseline_m;
  if (baseline_m <= 0 || std::isnan(body.x_m)) return 0;
  return deviations_90 * run.range_error_m() * std::hypot(body.x_m, body.z_m) / baseline_m;
}

std::size_t predictor_count(Inputs inputs) { return both_sensors(inputs) ? 3 : 2; }

}  // namespace

bool side_by_ranges(const Dataset& data, Inputs inputs) {
  return inputs == Inputs::fused_profile ||
         (inputs == Inputs::fused && data.array().axis.count == 0);
}

Matrix predictors_of(const Matrix& maps, const SceneModel& scene, const Dataset& data,
                     const Rows& rows, Inputs inputs) {
  Matrix out(rows.size(), predictor_count(inputs));
  for_each_part(rows.size(), [&](std::size_t i) {
    const auto row = out.row(i);
    row.front() = static_cast<float>(std::abs(foreground_tangent(maps.row(i), scene)));
    if (inputs != Inputs::radar) row[1] = std::log(significance(counts_of(data, rows[i])) + 1);
    if (inputs == Inputs::spd) return;
    const double smoothed =
        data.sources.empty() ? 1 : data.sources[data.source_of(rows[i])].response.noise_factor;
    row.back() = std::log(peak_to_noise(beyond_leakage(data.radar(), rows[i])) *
                          static_cast<float>(std::min(smoothed, 1.)));
  });
  return out;
}

std::vector<float> LateralError::terms_of(std::span<const float> predictors) const {
  std::vector<float> out(predictors.size());
  for (std::size_t c = 0; c < out.size(); ++c)
    out[c] = (std::clamp(predictors[c], minimum_[c], maximum_[c]) - minimum_[c]) /
             std::max(maximum_[c] - minimum_[c], 1e-6f);
  return quadratic_terms(out);
}

void LateralError::fit(const Matrix& predictors, const std::vector<double>& error_m,
                       std::size_t plain) {
  Rows known;
  std::size_t known_plain = 0;
  for (std::size_t i = 0; i < predictors.rows; ++i) {
    if (std::isnan(error_m[i])) continue;
    known.push_back(i);
    known_plain += i < plain;
  }
  if (known_plain < min_records) return;
  minimum_ = maximum_ = std::vector<float>(predictors.row(known.front()).begin(),
                                           predictors.row(known.front()).end());
  for (const std::size_t i : known)
    for (std::size_t c = 0; c < predictors.cols; ++c) {
      minimum_[c] = std::min(minimum_[c], predictors.row(i)[c]);
      maximum_[c] = std::max(maximum_[c], predictors.row(i)[c]);
    }
  Matrix terms;
  std::vector<float> targets;
  for (const std::size_t i : known) {
    const auto row = terms_of(predictors.row(i));
    terms.cols = row.size();
    terms.add_row(row);
    targets.push_back(static_cast<float>(std::log(std::max(error_m[i], smallest_error_m))));
  }
  weights_ = linear_fit(terms, targets, std::vector<float>(targets.size(), 1.f), penalty);
  std::vector<double> ratios;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<float> counts;  // weight of each record; 0 for held-out records and their copies
    for (const std::size_t i : known) counts.push_back(i % plain % folds == fold ? 0.f : 1.f);
    const auto weights = linear_fit(terms, targets, counts, penalty);
    for (std::size_t i = 0; i < known_plain; ++i)
      if (counts[i] == 0)
        ratios.push_back(error_m[known[i]] / std::exp(product(terms.row(i), weights)));
  }
  factors_ = {factor_of(std::move(ratios))};
}

void LateralError::add_converted(double times_wider, const Matrix& predictors,
                                 const std::vector<double>& error_m) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < predictors.rows && !weights_.empty(); ++i)
    if (!std::isnan(error_m[i]))
      ratios.push_back(error_m[i] / std::exp(product(terms_of(predictors.row(i)), weights_)));
  if (ratios.size() < min_records) return;
  times_wider_.push_back(times_wider);
  factors_.push_back(factor_of(std::move(ratios)));
}

double LateralError::operator()(std::span<const float> predictors, double times_wider) const {
  if (weights_.empty() || std::isnan(predictors.front()))
    return std::numeric_limits<double>::quiet_NaN();
  return interpolated(times_wider_, factors_, times_wider)[0] *
         std::exp(product(terms_of(predictors), weights_));
}

void LateralError::archive(Archive archive, std::size_t predictors) {
  if (!archive.part("known", !weights_.empty())) return;
  const std::size_t n = predictors;
  factors_.resize(std::max<std::size_t>(factors_.size(), 1));
  archive.number("factor", factors_[0], 0, 1e18);
  std::size_t converted = factors_.size() - 1;
  archive.count("brought", converted, 0, 16);
  const auto put = [&](const char* name, std::vector<double>& of) {
    std::vector<double> more(of.begin() + 1, of.end());
    archive.values(name, more, converted);
    of.resize(1), of.insert(of.end(), more.begin(), more.end());
  };
  put("brought_times_wider", times_wider_), put("brought_factor", factors_);
  for (std::size_t k = 1; k <= converted; ++k)
    archive.require(times_wider_[k] > times_wider_[k - 1] && factors_[k] >= 0,
                    "brought_times_wider", "expected ascending values above 1");
  archive.values("weights", weights_, (n + 1) * (n + 2) / 2);
  archive.values("least", minimum_, n);
  archive.values("most", maximum_, n);
  for (std::size_t c = 0; c < n; ++c)
    archive.require(minimum_[c] <= maximum_[c], "least", "expected at most the value in \"most\"");
}

std::vector<PredictionUncertainty> UncertaintyModel::trust(const Matrix& views, const Matrix& maps,
                                                           const SceneModel& scene,
                                                           const Dataset& data, const Rows& rows,
                                                           Inputs inputs) const {
  const Matrix predictors = predictors_of(maps, scene, data, rows, inputs);
  std::vector<PredictionUncertainty> out;
  for (OutOfDistributionScore& score : detector.score(views, data, rows)) {
    const std::size_t i = out.size();
    const double interval_m = std::hypot(lateral(predictors.row(i), times_wider(data, rows[i])),
                                         range_error_m(data, rows[i], inputs, maps.row(i), scene));
    const bool like_training = score.reason.empty();
    out.push_back({like_training ? interval_m : std::numeric_limits<double>::quiet_NaN(),
                   std::move(score), true});
  }
  return out;
}

void UncertaintyModel::archive(Archive archive, const Features& of_model,
                               const Alignment& alignment) {
  detector.archive(archive.in("out_of_distribution"), of_model, alignment);
  lateral.archive(archive.in("lateral"), predictor_count(of_model.inputs));
  pixels.archive(archive.in("pixels"));
}

std::vector<double> linear_fit(const Matrix& inputs, std::span<const float> targets,
                               std::span<const float> counts, double l2_penalty) {
  const std::size_t n = inputs.rows, d = inputs.cols;
  std::vector<float> x = inputs.values;
  std::vector<float> squares(d * d), scale(d);
  std::vector<double> expected(d);
  const double all = std::accumulate(counts.begin(), counts.end(), 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const auto root = static_cast<float>(std::sqrt(double{counts[i]} / all));
    for (std::size_t c = 0; c < d; ++c) {
      float& v = x[i * d + c];
      v *= root;
      scale[c] += v * v;
      expected[c] += double{v} * double{targets[i] * root};
    }
  }
  for (float& s : scale) s = s > 0 ? 1 / std::sqrt(s) : 0;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t c = 0; c < d; ++c) x[i * d + c] *= scale[c];
  for (std::size_t c = 0; c < d; ++c) expected[c] *= double{scale[c]};
  multiply({d, d, n, Transpose::yes, Transpose::no}, x.data(), x.data(), squares.data());
  const auto size = static_cast<Eigen::Index>(d);
  Eigen::MatrixXd normal = Eigen::Map<Eigen::MatrixXf>(squares.data(), size, size).cast<double>();
  normal.diagonal().array() += l2_penalty;
  const Eigen::VectorXd solved =
      normal.ldlt().solve(Eigen::Map<Eigen::VectorXd>(expected.data(), size));
  std::vector<double> out(d);
  for (std::size_t c = 0; c < d; ++c)
    out[c] = solved(static_cast<Eigen::Index>(c)) * double{scale[c]};
  return out;
}

double product(std::span<const float> row, std::span<const double> weights) {
  return std::inner_product(row.begin(), row.end(), weights.begin(), 0.0);
}

std::vector<float> quadratic_terms(std::span<const float> values) {
  std::vector<float> out{1};
  out.reserve((values.size() + 1) * (values.size() + 2) / 2);
  out.insert(out.end(), values.begin(), values.end());
  for (std::size_t i = 0; i < values.size(); ++i)
    for (std::size_t j = 0; j <= i; ++j) out.push_back(values[i] * values[j]);
  return out;
}

}  // namespace echofuse::recon
