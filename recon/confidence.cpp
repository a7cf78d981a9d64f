// SPDX-License-Identifier: MIT
#include "recon/confidence.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "drivers/core/random.hpp"
#include "recon/maps/metrics.hpp"
#include "recon/maps/statistics.hpp"
#include "recon/models/linear_fit.hpp"
#include "recon/trained_model.hpp"

namespace echofuse::recon {
namespace {

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();
constexpr std::uint64_t noise_stream = 0x6e6f6973;  // "nois"
constexpr std::size_t worse_copies = 3;
constexpr double fewest_photons_log10 = -2.5;  // share of a worse copy's photons
constexpr double least_noise_log10 = -2, most_noise_log10 = -0.3;  // radar, against its peak
constexpr double smallest_error_m = 3e-3;  // below which errors are all alike
constexpr double penalty = 1e-3;

// Clicks above the background, in deviations of all clicks.
float significance(std::span<const float> counts) {
  std::vector<float> sorted(counts.begin(), counts.end());
  const float level = quantile(sorted, 0.5);
  double above = 0, all = 0;
  for (const float v : counts) above += double{v - level}, all += double{v};
  return static_cast<float>(std::max(above, 0.0) / std::sqrt(all + 1));
}

// Peak over the scatter of the weaker half of the profile.
float peak_to_noise(std::span<const float> power) {
  std::vector<float> sorted(power.begin(), power.end());
  std::sort(sorted.begin(), sorted.end());
  const std::size_t half = sorted.size() / 2;
  double mean = 0, square = 0;
  for (std::size_t i = 0; i <= half; ++i) mean += double{sorted[i]} / double(half + 1);
  for (std::size_t i = 0; i <= half; ++i)
    square += std::pow(double{sorted[i]} - mean, 2) / double(half + 1);
  return static_cast<float>((double{sorted.back()} - mean) / std::max(std::sqrt(square), 1e-12));
}

// What is known at the prediction of how good it will be: one row a map.
Matrix signs_of(const TrainedModel& model, const Dataset& data, const Rows& rows,
                const Matrix& maps) {
  const Inputs inputs = model.features.inputs;
  Matrix out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    std::vector<float> signs{
        static_cast<float>(std::abs(foreground_tangent(maps.row(i), model.scene)))};
    if (inputs != Inputs::radar) signs.push_back(std::log(significance(data.spd.row(rows[i])) + 1));
    if (inputs != Inputs::spd) signs.push_back(std::log(peak_to_noise(data.radar.row(rows[i]))));
    out.cols = signs.size();
    out.add_row(signs);
  }
  return out;
}

// The rows of a data set as one of their own, with fewer photons and a noisier radar.
Dataset made_worse(const Dataset& data, const Rows& rows, Rng* rng) {
  Dataset out;
  out.spd_axis = data.spd_axis, out.radar_axis = data.radar_axis;
  out.spd = take_rows(data.spd, rows), out.radar = take_rows(data.radar, rows);
  out.depth = take_rows(data.depth, rows);
  for (const std::size_t row : rows) out.valid.push_back(data.valid[row]);
  if (!rng) return out;
  std::uniform_real_distribution<double> photons(fewest_photons_log10, 0);
  std::uniform_real_distribution<double> noise(least_noise_log10, most_noise_log10);
  std::normal_distribution<float> normal;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double share = std::pow(10, photons(*rng));
    for (float& v : out.spd.row(i))
      v = static_cast<float>(
          std::binomial_distribution<int>(std::max(static_cast<int>(v), 0), share)(*rng));
    const auto power = out.radar.row(i);
    if (power.empty()) continue;
    const float deviation = *std::max_element(power.begin(), power.end()) *
                            static_cast<float>(std::pow(10, noise(*rng)));
    for (float& v : power) v += deviation * normal(*rng);
  }
  return out;
}

std::vector<double> lateral_errors(const Matrix& maps, const Dataset& data, const Scene& scene) {
  std::vector<double> out;
  for (std::size_t i = 0; i < maps.rows; ++i)
    out.push_back(lateral_error(maps.row(i), data.depth.row(i), scene));
  return out;
}

// The lateral error as that of a normal distribution.
SoftMaps soft_maps(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   const Matrix& maps, const std::vector<double>& lateral_90_m) {
  constexpr double deviations_90 = 1.645;
  auto own = model.model->predict_soft(model.features.apply(data, rows));
  if (!own) return soft_of(maps, model.scene);
  std::vector<double> deviation_m = lateral_90_m;
  for (double& d : deviation_m) d /= deviations_90;
  blur(*own, deviation_m);
  return std::move(*own);
}

}  // namespace

std::vector<float> LateralError::terms_of(std::span<const float> signs) const {
  std::vector<float> out(signs.size());
  for (std::size_t c = 0; c < out.size(); ++c)
    out[c] = (std::clamp(signs[c], least_[c], most_[c]) - centre_[c]) / spread_[c];
  return quadratic_terms(out);
}

void LateralError::fit(const Matrix& signs, const std::vector<double>& error_m, std::size_t plain) {
  Rows known;
  std::size_t known_plain = 0;
  for (std::size_t i = 0; i < signs.rows; ++i) {
    if (std::isnan(error_m[i])) continue;
    known.push_back(i);
    known_plain += i < plain;
  }
  if (known_plain < Confidence::least_validation) return;
  const ColumnStatistics columns = column_statistics(signs, known);
  centre_.assign(columns.mean.begin(), columns.mean.end());
  least_ = most_ =
      std::vector<float>(signs.row(known.front()).begin(), signs.row(known.front()).end());
  for (std::size_t c = 0; c < signs.cols; ++c) {
    spread_.push_back(static_cast<float>(std::sqrt(std::max(columns.variance[c], 1e-12))));
    for (const std::size_t i : known) {
      least_[c] = std::min(least_[c], signs.row(i)[c]);
      most_[c] = std::max(most_[c], signs.row(i)[c]);
    }
  }
  Matrix terms;
  std::vector<float> targets;
  for (const std::size_t i : known) {
    const auto row = terms_of(signs.row(i));
    terms.cols = row.size();
    terms.add_row(row);
    targets.push_back(static_cast<float>(std::log(std::max(error_m[i], smallest_error_m))));
  }
  weights_ = linear_fit(terms, targets, std::vector<float>(targets.size(), 1.f), penalty);
  std::vector<double> ratios;
  for (std::size_t i = 0; i < known_plain; ++i)
    ratios.push_back(error_m[known[i]] / std::exp(product(terms.row(i), weights_)));
  std::sort(ratios.begin(), ratios.end());
  const auto rank =
      static_cast<std::size_t>(std::ceil(share_within * static_cast<double>(ratios.size() + 1)));
  factor_ = ratios[std::min(rank, ratios.size()) - 1];
}

double LateralError::operator()(std::span<const float> signs) const {
  if (weights_.empty() || std::isnan(signs.front())) return nothing;
  return factor_ * std::exp(product(terms_of(signs), weights_));
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

void LateralError::load(const record::H5File& file, const std::string& group) {
  factor_ = file.get<double>(group, "factor");
  weights_ = file.read<double>(group + "/weights");
  centre_ = file.read<float>(group + "/centre");
  spread_ = file.read<float>(group + "/spread");
  least_ = file.read<float>(group + "/least");
  most_ = file.read<float>(group + "/most");
  const std::size_t n = centre_.size();
  require_sound(spread_.size() == n && least_.size() == n && most_.size() == n &&
                    weights_.size() == (n > 0 ? (n + 1) * (n + 2) / 2 : 0),
                "sizes of " + group);
}

void Confidence::save(record::H5File& file) const {
  novelty.save(file, "confidence/novelty");
  pixels.save(file, "confidence/pixels");
  lateral.save(file, "confidence/lateral");
}

void Confidence::load(const record::H5File& file, const Features& of_model) {
  novelty.load(file, "confidence/novelty", of_model);
  lateral.load(file, "confidence/lateral");
  pixels.load(file, "confidence/pixels");
}

bool can_judge(const Split& split) {
  return split.train.size() >= Novelty::least_records &&
         split.validation.size() >= Confidence::least_validation;
}

Confidence fit_confidence(const TrainedModel& model, const Dataset& data, const Split& split,
                          std::uint64_t seed) {
  Confidence out;
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  out.novelty = Novelty(data, rows, model.features.inputs, seed);
  Rng rng = make_rng(seed, noise_stream);
  Matrix signs;
  std::vector<double> errors;
  for (std::size_t copy = 0; copy <= worse_copies; ++copy) {
    const Dataset part = made_worse(data, split.validation, copy > 0 ? &rng : nullptr);
    const Rows all = all_rows(part.size());
    const Matrix maps = model.predict(part, all);
    const Matrix some = signs_of(model, part, all, maps);
    signs.cols = some.cols;
    for (const std::size_t i : all) signs.add_row(some.row(i));
    const auto more = lateral_errors(maps, part, model.scene);
    errors.insert(errors.end(), more.begin(), more.end());
  }
  out.lateral.fit(signs, errors, split.validation.size());
  std::vector<double> lateral_90_m;
  for (std::size_t i = 0; i < split.validation.size(); ++i)
    lateral_90_m.push_back(out.lateral(signs.row(i)));
  const Matrix maps = model.predict(data, split.validation);
  out.pixels.fit(soft_maps(model, data, split.validation, maps, lateral_90_m),
                 take_rows(data.depth, split.validation), model.scene);
  return out;
}

std::vector<Claim> claims(const TrainedModel& model, const Dataset& data, const Rows& rows,
                          const Matrix& maps) {
  std::vector<Claim> out(rows.size());
  for (const auto& [by, places, own_rows] : model.shares(data, rows)) {
    const Confidence& confidence = by.confidence.value();
    const auto strangeness = confidence.novelty.judge(data, own_rows);
    const Matrix signs = signs_of(by, data, own_rows, take_rows(maps, places));
    for (std::size_t i = 0; i < places.size(); ++i)
      out[places[i]] = {confidence.lateral(signs.row(i)), strangeness[i]};
  }
  return out;
}

PixelMaps pixel_maps(const TrainedModel& model, const Dataset& data, const Rows& rows,
                     const Matrix& maps, const std::vector<Claim>& claims) {
  const Matrix none(rows.size(), maps.cols);
  PixelMaps out{none, none, none};
  for (const auto& [by, places, own_rows] : model.shares(data, rows)) {
    std::vector<double> lateral_90_m;
    for (const std::size_t place : places) lateral_90_m.push_back(claims[place].lateral_90_m);
    const PixelMaps some = by.confidence.value().pixels(
        soft_maps(by, data, own_rows, take_rows(maps, places), lateral_90_m), by.scene);
    for (std::size_t i = 0; i < places.size(); ++i) {
      for (Matrix PixelMaps::*part :
           {&PixelMaps::probability, &PixelMaps::mean, &PixelMaps::deviation})
        std::copy_n((some.*part).row(i).begin(), maps.cols, (out.*part).row(places[i]).begin());
    }
  }
  return out;
}

Answer answer(const TrainedModel& model, const Dataset& data, const Rows& rows,
              const std::string& output, bool with_deviation) {
  const bool with_pixels = with_deviation || output == "mean";
  if (with_pixels && !model.confidence)
    throw Error(
        ExitCode::usage,
        "the model does not know how sure it is: it was trained on too few records (100, and "
        "30 validation records) or by an older version; train it anew");
  Answer out{model.predict(data, rows), {}, {}};
  if (model.confidence) out.claims = claims(model, data, rows, out.maps);
  if (with_pixels) {
    PixelMaps pixels = pixel_maps(model, data, rows, out.maps, out.claims);
    if (output == "mean") out.maps = std::move(pixels.mean);
    if (with_deviation) out.deviation = std::move(pixels.deviation);
  }
  for (std::size_t i = 0; i < out.maps.rows && output == "hard"; ++i) {
    const auto map = hard_map(out.maps.row(i), model.scene);
    std::copy(map.begin(), map.end(), out.maps.row(i).begin());
  }
  return out;
}

}  // namespace echofuse::recon
