// SPDX-License-Identifier: MIT
#include "recon/estimator/answer.hpp"

#include <algorithm>
#include <cmath>

#include "recon/maps/metrics.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

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
  PixelMaps out{none, none};
  for (const auto& [by, places, own_rows] : model.shares(data, rows)) {
    std::vector<double> lateral_90_m;
    for (const std::size_t place : places) lateral_90_m.push_back(claims[place].lateral_90_m);
    const PixelMaps some = by.confidence.value().pixels(
        soft_maps(by, data, own_rows, take_rows(maps, places), lateral_90_m), by.scene);
    for (std::size_t i = 0; i < places.size(); ++i) {
      std::copy_n(some.mean.row(i).begin(), maps.cols, out.mean.row(places[i]).begin());
      std::copy_n(some.deviation.row(i).begin(), maps.cols, out.deviation.row(places[i]).begin());
    }
  }
  return out;
}

}  // namespace

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

void require_confidence(const TrainedModel& model) {
  if (!model.confidence)
    throw Error(ExitCode::usage,
                "the model does not know how sure it is: it was trained on too few records (100, "
                "and 30 validation records), its training was interrupted, or an older version "
                "trained it; train it anew");
}

Answer answer(const TrainedModel& model, const Dataset& data, const Rows& rows,
              const std::string& output, bool with_deviation) {
  const bool with_pixels = with_deviation || output == "mean";
  if (with_pixels) require_confidence(model);
  Answer out{model.predict(data, rows), {}, {}, {}};
  if (model.confidence) out.claims = claims(model, data, rows, out.maps);
  if (with_pixels) {
    PixelMaps pixels = pixel_maps(model, data, rows, out.maps, out.claims);
    require_finite(pixels.mean), require_finite(pixels.deviation);
    out.mean = std::move(pixels.mean), out.deviation = std::move(pixels.deviation);
  }
  choose_output(out, output, model.scene);
  return out;
}

void choose_output(Answer& own, const std::string& output, const Scene& scene) {
  if (output == "mean") own.maps = std::move(own.mean);
  for (std::size_t i = 0; i < own.maps.rows && output == "hard"; ++i) {
    const auto map = hard_map(own.maps.row(i), scene);
    std::copy(map.begin(), map.end(), own.maps.row(i).begin());
  }
}

}  // namespace echofuse::recon
