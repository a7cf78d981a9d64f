// SPDX-License-Identifier: MIT
#include "recon/network/classifier.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "drivers/core/random.hpp"
#include "drivers/util/console.hpp"
#include "recon/network/adam.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t weight_stream = 1, draw_stream = 2;
constexpr float min_spread = 0.05f;  // minimum spread of an input, relative to the median spread

float share_of(float log_odds) { return 1 / (1 + std::exp(-log_odds)); }

}  // namespace

void Classifier::learn_scale(const Matrix& usual, const Matrix& other) {
  const auto a = column_statistics(usual, all_rows(usual.rows)),
             b = column_statistics(other, all_rows(other.rows));
  centre_.clear(), spread_.clear();
  for (std::size_t c = 0; c < usual.cols; ++c) {
    const double apart = a.mean[c] - b.mean[c];
    centre_.push_back(static_cast<float>((a.mean[c] + b.mean[c]) / 2));
    spread_.push_back(
        static_cast<float>(std::sqrt((a.variance[c] + b.variance[c]) / 2 + apart * apart / 4)));
  }
  std::vector<float> sorted = spread_;
  const float minimum = min_spread * quantile(sorted, 0.5);
  for (float& v : spread_) {
    v = std::max(v, minimum);
    if (v == 0) v = 1;
  }
}

void Classifier::standardise(std::span<const float> inputs, std::span<float> out) const {
  for (std::size_t c = 0; c < out.size(); ++c) out[c] = (inputs[c] - centre_[c]) / spread_[c];
}

void Classifier::fit(const Matrix& usual, const Matrix& other, const Options& options) {
  learn_scale(usual, other);
  std::vector<std::size_t> widths{usual.cols};
  widths.insert(widths.end(), options.hidden.begin(), options.hidden.end());
  widths.push_back(1);
  network_ = make_network(widths);
  Rng weights = make_rng(options.seed, weight_stream), draw = make_rng(options.seed, draw_stream);
  parameters_ = initial_parameters(network_, weights);
  Adam adam(network_.parameters, 0);
  Activations<float> activations;
  std::vector<float> gradient;
  Matrix batch(options.batch, usual.cols);
  // Standardises all examples in advance, because each example is sampled many times.
  const auto standardised = [&](Matrix rows) {
    for (std::size_t i = 0; i < rows.rows; ++i) standardise(rows.row(i), rows.row(i));
    return rows;
  };
  const Matrix ones = standardised(usual), others = standardised(other);
  std::uniform_int_distribution<std::size_t> any_usual(0, usual.rows - 1),
      any_other(0, other.rows - 1);
  for (std::size_t step = 0; step < options.steps && !interrupted(); ++step) {
    for (std::size_t i = 0; i < batch.rows; ++i)
      std::ranges::copy(i % 2 ? others.row(any_other(draw)) : ones.row(any_usual(draw)),
                        batch.row(i).begin());
    forward(network_, parameters_, batch.values.data(), batch.rows, activations);
    auto& slope = activations.back();
    for (std::size_t i = 0; i < batch.rows; ++i)
      slope[i] = (share_of(slope[i]) - static_cast<float>(i % 2)) / static_cast<float>(batch.rows);
    backward(network_, parameters_, batch.values.data(), batch.rows, activations, gradient);
    const double done = static_cast<double>(step) / static_cast<double>(options.steps);
    adam.step(parameters_, gradient, options.learning_rate * 0.5 * (1 + std::cos(M_PI * done)));
  }
}

double Classifier::operator()(std::span<const float> inputs) const {
  std::vector<float> scaled(inputs.size());
  standardise(inputs, scaled);
  Activations<float> activations;
  forward(network_, parameters_, scaled.data(), 1, activations);
  return double{activations.back().front()};
}

void Classifier::archive(Archive archive, std::size_t inputs) {
  archive.values("centre", centre_, inputs);
  archive.values("spread", spread_, inputs);
  archive.require(std::all_of(spread_.begin(), spread_.end(), [](float s) { return s > 0; }),
                  "spread", "expected positive values only");
  recon::archive(archive, network_, parameters_, inputs, 1);
}

}  // namespace echofuse::recon
