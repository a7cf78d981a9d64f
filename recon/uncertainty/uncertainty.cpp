// SPDX-License-Identifier: MIT
#include "recon/uncertainty/uncertainty.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "recon/numbers/linear_fit.hpp"
#include "recon/numbers/matrix_file.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/uncertainty/predictors.hpp"

namespace echofuse::recon {
namespace {

constexpr double smallest_error_m = 3e-3;  // below which errors count the same
constexpr double penalty = 1e-3;
constexpr std::size_t folds = 5;

}  // namespace

std::vector<float> LateralError::terms_of(std::span<const float> predictors) const {
  std::vector<float> out(predictors.size());
  for (std::size_t c = 0; c < out.size(); ++c)
    out[c] = (std::clamp(predictors[c], least_[c], most_[c]) - centre_[c]) / spread_[c];
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
  if (known_plain < least_records) return;
  const ColumnStatistics columns = column_statistics(predictors, known);
  centre_.assign(columns.mean.begin(), columns.mean.end());
  least_ = most_ = std::vector<float>(predictors.row(known.front()).begin(),
                                      predictors.row(known.front()).end());
  for (std::size_t c = 0; c < predictors.cols; ++c) {
    spread_.push_back(static_cast<float>(std::sqrt(std::max(columns.variance[c], 1e-12))));
    for (const std::size_t i : known) {
      least_[c] = std::min(least_[c], predictors.row(i)[c]);
      most_[c] = std::max(most_[c], predictors.row(i)[c]);
    }
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
    std::vector<float> counts;  // a record's copies are held out with it
    for (const std::size_t i : known) counts.push_back(i % plain % folds == fold ? 0.f : 1.f);
    const auto weights = linear_fit(terms, targets, counts, penalty);
    for (std::size_t i = 0; i < known_plain; ++i)
      if (counts[i] == 0)
        ratios.push_back(error_m[known[i]] / std::exp(product(terms.row(i), weights)));
  }
  std::sort(ratios.begin(), ratios.end());
  const auto rank =
      static_cast<std::size_t>(std::ceil(share_within * static_cast<double>(ratios.size() + 1)));
  factor_ = ratios[std::min(rank, ratios.size()) - 1];
}

double LateralError::operator()(std::span<const float> predictors) const {
  if (weights_.empty() || std::isnan(predictors.front()))
    return std::numeric_limits<double>::quiet_NaN();
  return factor_ * std::exp(product(terms_of(predictors), weights_));
}

void LateralError::save(record::H5File& file, const std::string& group) const {
  file.make_group(group);
  file.set(group, "factor", factor_);
  file.write(group + "/weights", weights_, {weights_.size()});
  file.write(group + "/centre", centre_, {centre_.size()});
  file.write(group + "/spread", spread_, {spread_.size()});
  file.write(group + "/least", least_, {least_.size()});
  file.write(group + "/most", most_, {most_.size()});
}

void LateralError::load(const record::H5File& file, const std::string& group,
                        std::size_t predictors) {
  factor_ = file.get<double>(group, "factor");
  centre_ = file.read<float>(group + "/centre", {record::H5File::any});
  const std::size_t n = centre_.size();
  require_sound(file, n == 0 || n == predictors, group + "/centre",
                "0 or " + std::to_string(predictors) + " values");
  weights_ = file.read<double>(group + "/weights", {n > 0 ? (n + 1) * (n + 2) / 2 : 0});
  spread_ = file.read<float>(group + "/spread", {n});
  least_ = file.read<float>(group + "/least", {n});
  most_ = file.read<float>(group + "/most", {n});
  for (std::size_t c = 0; c < n; ++c)
    require_sound(file, spread_[c] > 0 && least_[c] <= most_[c], group,
                  "a spread above 0, and least below most");
}

// Least squares of the logarithms; errors never grow with the distance.
void SeparatedError::fit(std::vector<Sum> sums) {
  if (sums.size() < LateralError::least_records) return;
  constexpr double least_times = 0.01, steepest = -3;
  constexpr double least_penalty = 1e-6;  // for sums that are all as far apart
  Matrix terms(0, 2);
  std::vector<float> targets;
  for (const Sum& s : sums) {
    terms.add_row(std::array{1.f, static_cast<float>(std::log(s.apart_m))});
    targets.push_back(static_cast<float>(std::log(std::max(s.times, least_times))));
  }
  const std::vector<float> counts(sums.size(), 1.f);
  exponent_ = std::clamp(linear_fit(terms, targets, counts, least_penalty)[1], steepest, 0.0);
  for (Sum& s : sums) s.times /= std::pow(s.apart_m, exponent_);
  std::sort(sums.begin(), sums.end(), [](const Sum& a, const Sum& b) { return a.times < b.times; });
  factor_ =
      sums[static_cast<std::size_t>(LateralError::share_within * static_cast<double>(sums.size()))]
          .times;
}

double SeparatedError::operator()(double apart_m) const {
  return factor_ > 0 ? factor_ * std::pow(apart_m, exponent_)
                     : std::numeric_limits<double>::quiet_NaN();
}

void SeparatedError::save(record::H5File& file, const std::string& group) const {
  file.set(group, "of_two", factor_);
  file.set(group, "of_two_exponent", exponent_);
}

// Models of before have no exponent, or neither.
void SeparatedError::load(const record::H5File& file, const std::string& group) {
  if (file.has_attribute(group, "of_two")) factor_ = file.get<double>(group, "of_two");
  if (file.has_attribute(group, "of_two_exponent"))
    exponent_ = file.get<double>(group, "of_two_exponent");
  require_sound(file, factor_ >= 0, group + "@of_two", "0 or more");
  require_sound(file, exponent_ >= -3 && exponent_ <= 0, group + "@of_two_exponent",
                "from -3 to 0");
}

void UncertaintyModel::judge_speckle(std::span<const float> aligned,
                                     const std::optional<record::Speckle>& found,
                                     PredictionUncertainty& stated) const {
  if (!found || (!aligned.empty() && !shows_body(aligned))) return;
  const double share = speckle.share(*found);
  OutOfDistributionScore& score = stated.out_of_distribution;
  score.distance = std::max(score.distance, share);
  if (share <= 1) return;
  // Noise of 10 dB makes so much; the profile shows that, and the interval grows with it.
  constexpr double most_of_noise = 0.7;
  if (score.reason == "unusual radar profile" && found->over_frames < most_of_noise &&
      !speckle.less_motion(*found))
    return;
  stated.lateral_interval_90_m = std::numeric_limits<double>::quiet_NaN();
  score.may_be_two = false;  // whatever else it shows, its places are not to be trusted
  // What has a name of its own stays, as it can be mended.
  if (!score.reason.empty() && !score.reason.starts_with("unusual") &&
      !score.reason.starts_with("two bodies"))
    return;
  score.reason = "unusual variation of the radar's power", score.details = speckle.text(*found);
}

void UncertaintyModel::save(record::H5File& file) const {
  detector.save(file, "uncertainty/out_of_distribution");
  pixels.save(file, "uncertainty/pixels");
  lateral.save(file, "uncertainty/lateral");
  speckle.save(file, "uncertainty/speckle");
  separated.save(file, "uncertainty/lateral");
}

void UncertaintyModel::load(const record::H5File& file, const Features& of_model,
                            const Alignment& alignment) {
  detector.load(file, "uncertainty/out_of_distribution", of_model, alignment);
  lateral.load(file, "uncertainty/lateral", predictor_count(of_model.inputs));
  separated.load(file, "uncertainty/lateral");
  pixels.load(file, "uncertainty/pixels");
  speckle.load(file, "uncertainty/speckle");
}

}  // namespace echofuse::recon
