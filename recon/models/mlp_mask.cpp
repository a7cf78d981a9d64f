// SPDX-License-Identifier: MIT
// Network with two outputs per pixel, mask and depth (mask_loss.hpp). Unlike the mask obtained by
// applying a fixed threshold to a regressed depth, the mask does not depend on the distance of the
// body.
#include <algorithm>
#include <cmath>
#include <random>

#include "recon/models/fit_maps.hpp"
#include "recon/models/mask_loss.hpp"
#include "recon/numbers/parallel.hpp"

namespace echofuse::recon {
namespace {

// Range and step of the mask threshold, in percent. The threshold with the best IoU on held-out
// records is used.
constexpr int min_threshold = 30, max_threshold = 60, threshold_step = 5;
// Standard deviation of the noise added to the inputs in training, relative to the rms of the
// inputs.
constexpr float input_noise = 0.1f;
constexpr float nearest_m = 1e-3f;  // minimum depth of a predicted return, m; must exceed 0

float probability(float log_odds) { return 1 / (1 + std::exp(-log_odds)); }

class MlpMask final : public Model {
 public:
  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override {
    background_ = train.scene->background;
    Training training = training_of(options);
    training.loss = loss_of(train);
    training.redraw = with_noise(train);
    const TrainingLog log =
        fit_maps(regression_, train, validation, training, "mask and depth map");
    choose_threshold(validation.rows.empty() ? train : validation);
    return log;
  }
  Matrix predict(const Matrix& inputs, SoftMaps* soft) const override {
    const Matrix outputs = regression_.predict(inputs);
    Matrix out(inputs.rows, background_.size()), body(soft ? inputs.rows : 0, out.cols),
        depth = body;
    for (std::size_t i = 0; i < out.rows; ++i) {
      const auto both = outputs.row(i);
      for (std::size_t p = 0; p < out.cols; ++p) {
        const float chance = probability(both[p]), z = std::max(both[out.cols + p], nearest_m);
        out.row(i)[p] = chance > threshold_ ? z : background_[p];
        if (soft) body.row(i)[p] = chance, depth.row(i)[p] = z;
      }
    }
    if (soft) *soft = {std::move(body), std::move(depth)};
    return out;
  }
  Cost cost() const override { return regression_.cost(); }
  FitOptions sizes() const override { return {.hidden = regression_.hidden()}; }
  void archive(Archive archive, const Shape& shape) override {
    regression_.archive(archive, shape.inputs, 2 * shape.outputs);
    archive.values("background_m", background_, shape.outputs);
    archive.number("threshold", threshold_, 0.0, 1.0);
  }

 private:
  // Sets the initial outputs of the network to the mean mask and to the mean foreground depth of
  // each pixel.
  Loss loss_of(const Samples& train) const {
    const std::size_t pixels = background_.size();
    std::vector<double> count(pixels), sum(pixels);
    double all = 0, total = 0, squares = 0;
    for (const std::size_t row : train.rows)
      for (std::size_t p = 0; p < pixels; ++p)
        if (const float z = train.maps.row(row)[p]; true_foreground(z, background_[p]))
          ++count[p], sum[p] += double{z}, ++all, total += double{z},
              squares += double{z} * double{z};
    const double mean = all > 0 ? total / all : 1;
    const double variance = all > 0 ? squares / all - mean * mean : 0;
    const auto spread =
        static_cast<float>(std::max(std::sqrt(std::max(variance, 0.0)), 0.01 * mean));
    Loss out{std::vector<float>(2 * pixels), std::vector<float>(2 * pixels, 1), {}};
    for (std::size_t p = 0; p < pixels; ++p) {
      const double without = static_cast<double>(train.rows.size()) - count[p];
      out.centre[p] = static_cast<float>(std::log((count[p] + 1) / (without + 1)));
      // Pixels with few foreground returns start closer to the mean over all pixels.
      out.centre[pixels + p] = static_cast<float>((sum[p] + 10 * mean) / (count[p] + 10));
      out.spread[pixels + p] = spread;
    }
    out.to_slopes = [this, spread](std::span<const float> target, std::span<float> outputs) {
      return mask_loss<float>(target, background_, spread, outputs);
    };
    return out;
  }
  // Adds noise to the inputs, which reduces overfitting.
  static Redraw with_noise(const Samples& train) {
    double squares = 0;
    for (const std::size_t row : train.rows)
      for (const float v : train.inputs.row(row)) squares += double{v} * double{v};
    const double values = static_cast<double>(train.rows.size() * train.inputs.cols);
    const float deviation =
        input_noise * static_cast<float>(std::sqrt(squares / std::max(values, 1.0)));
    return [deviation](std::span<const std::size_t>, Matrix& inputs, Matrix&, Rng& rng) {
      std::normal_distribution<float> noise(0, deviation);
      for (float& v : inputs.values) v += noise(rng);
    };
  }
  void choose_threshold(const Samples& samples) {
    const Matrix outputs = regression_.predict(take_rows(samples.inputs, samples.rows));
    const std::size_t pixels = background_.size();
    double best = -1;
    for (int percent = min_threshold; percent <= max_threshold; percent += threshold_step) {
      const float share = static_cast<float>(percent) / 100, odds = std::log(share / (1 - share));
      double sum = 0;
      for (std::size_t i = 0; i < outputs.rows; ++i) {
        std::size_t both = 0, any = 0;
        for (std::size_t p = 0; p < pixels; ++p) {
          const bool found = outputs.row(i)[p] > odds;
          const bool body = true_foreground(samples.maps.row(samples.rows[i])[p], background_[p]);
          both += found && body, any += found || body;
        }
        if (any > 0) sum += static_cast<double>(both) / static_cast<double>(any);
      }
      if (sum > best) best = sum, threshold_ = share;
    }
  }

  Regression regression_;
  std::vector<float> background_;  // depth of the background, m
  float threshold_ = 0.5f;
};

}  // namespace

std::unique_ptr<Model> make_mlp_mask() { return std::make_unique<MlpMask>(); }

}  // namespace echofuse::recon
