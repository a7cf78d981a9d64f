// SPDX-License-Identifier: MIT
// The paper's plain network: concatenated inputs, two hidden layers, a 64 x 64 linear output,
// squared loss. It predicts the difference to the mean map, in units of the maps' spread.
#include <algorithm>
#include <cmath>
#include <limits>

#include "drivers/core/console.hpp"
#include "recon/maps/scene.hpp"
#include "recon/models/checkpoint.hpp"
#include "recon/models/model.hpp"
#include "recon/models/network.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t weight_stream = 1, order_stream = 2;

// From the full rate down to nothing along half a cosine (Loshchilov and Hutter, ICLR 2017).
double annealed(double rate, double progress) {
  return rate * 0.5 * (1 + std::cos(M_PI * progress));
}

class Mlp final : public Model {
 public:
  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override;
  Matrix predict(const Matrix& inputs) const override;
  Cost cost() const override { return {network_.weights, network_.parameters}; }
  void save(record::H5File& file) const override;
  void load(const record::H5File& file) override;

 private:
  void standardise(const Samples& train);
  void train_epoch(const Samples& train, const FitOptions& options, TrainingState& s,
                   Checkpoints& checkpoints);
  double train_batch(const Samples& train, std::span<const std::size_t> rows, TrainingState& s,
                     double learning_rate);
  void judge(const Samples& validation, TrainingState& s);
  Matrix maps_of(const Matrix& inputs, const std::vector<float>& parameters) const;
  double rmse(const Samples& samples, const std::vector<float>& parameters) const;

  std::vector<std::size_t> widths_;
  Network network_;
  std::vector<float> parameters_;
  std::vector<float> centre_;  // metres
  float spread_ = 1;           // metres: root mean square difference to the centre
  Matrix batch_inputs_;        // scratch of train_batch
  Activations<float> activations_;
  std::vector<float> gradient_;
};

// The mean map and the spread about it.
void Mlp::standardise(const Samples& train) {
  centre_ = learn_scene(train.maps, train.rows).mean_map;
  double sum = 0;
  for (const std::size_t row : train.rows)
    for (std::size_t p = 0; p < centre_.size(); ++p)
      sum += std::pow(double{train.maps.row(row)[p]} - double{centre_[p]}, 2);
  const double mean = sum / static_cast<double>(train.rows.size() * centre_.size());
  spread_ = mean > 0 ? static_cast<float>(std::sqrt(mean)) : 1;
}

TrainingLog Mlp::fit(const Samples& train, const Samples& validation, const FitOptions& options) {
  standardise(train);
  widths_ = {train.inputs.cols};
  widths_.insert(widths_.end(), options.hidden.begin(), options.hidden.end());
  widths_.push_back(train.maps.cols);
  network_ = make_network(widths_);
  Rng weight_rng = make_rng(options.seed, weight_stream);
  TrainingState s{.parameters = initial_parameters(network_, weight_rng),
                  .best = {},
                  .adam = Adam(network_.parameters, options.weight_decay),
                  .order = train.rows,
                  .order_rng = make_rng(options.seed, order_stream),
                  .log = {},
                  .least = std::numeric_limits<double>::max()};
  s.best = s.parameters;
  Checkpoints checkpoints(options.checkpoint);
  checkpoints.resume(s);
  Progress progress("training", options.epochs, options.quiet);
  while (s.epoch < options.epochs && s.epoch - s.log.best_epoch < options.patience) {
    train_epoch(train, options, s, checkpoints);
    const bool broken = interrupted();
    if (broken)
      checkpoints.save(s);  // before what there is of this epoch is judged like a whole one
    if (s.row == 0) break;
    judge(validation, s);
    progress.update(s.epoch, "validation " + std::to_string(s.log.validation_loss.back()) + " m");
    if (broken) break;
  }
  s.log.interrupted = interrupted();
  s.log.earlier_s = checkpoints.earlier_s();
  parameters_ = std::move(s.best);
  return s.log;
}

// To the end of the epoch, or as far as it comes before an interrupt.
void Mlp::train_epoch(const Samples& train, const FitOptions& options, TrainingState& s,
                      Checkpoints& checkpoints) {
  if (s.row == 0) std::shuffle(s.order.begin(), s.order.end(), s.order_rng);
  const std::span<const std::size_t> rows(s.order);
  while (s.row < rows.size() && !interrupted()) {
    const std::size_t count = std::min(options.batch, rows.size() - s.row);
    const double done = static_cast<double>(s.epoch) +
                        static_cast<double>(s.row) / static_cast<double>(rows.size());
    const double rate = annealed(options.learning_rate, done / static_cast<double>(options.epochs));
    s.squares += train_batch(train, rows.subspan(s.row, count), s, rate);
    s.row += count;
    checkpoints.save_if_due(s);
  }
}

// Ends the epoch: its losses, and whether it is the best so far.
void Mlp::judge(const Samples& validation, TrainingState& s) {
  const double values = static_cast<double>(std::max<std::size_t>(s.row, 1) * centre_.size());
  s.log.loss.push_back(std::sqrt(s.squares / values) * double{spread_});
  if (!std::isfinite(s.log.loss.back()))
    throw Error(ExitCode::failed, "training diverged in epoch " + std::to_string(s.epoch + 1) +
                                      ": the loss is not a finite number; use a smaller "
                                      "--learning-rate");
  // Without validation records the last epoch is the best.
  const bool blind = validation.rows.empty();
  const double judged = blind ? -static_cast<double>(s.epoch) : rmse(validation, s.parameters);
  s.log.validation_loss.push_back(blind ? s.log.loss.back() : judged);
  ++s.epoch, s.row = 0, s.squares = 0;
  if (judged < s.least) s.least = judged, s.best = s.parameters, s.log.best_epoch = s.epoch;
}

// One step; returns the sum of squared errors, in units of the spread.
double Mlp::train_batch(const Samples& train, std::span<const std::size_t> rows, TrainingState& s,
                        double learning_rate) {
  batch_inputs_ = take_rows(train.inputs, {rows.begin(), rows.end()});
  const float* x = batch_inputs_.values.data();
  forward(network_, s.parameters, x, rows.size(), activations_);
  auto& output = activations_.back();
  const std::size_t pixels = centre_.size();
  const float per_value = 1.f / static_cast<float>(rows.size() * pixels);
  double sum = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto truth = train.maps.row(rows[i]);
    float* slope = output.data() + i * pixels;
    float squares = 0;
    for (std::size_t p = 0; p < pixels; ++p) {
      const float error = slope[p] - (truth[p] - centre_[p]) / spread_;
      squares += error * error;
      slope[p] = 2 * error * per_value;
    }
    sum += double{squares};
  }
  backward(network_, s.parameters, x, rows.size(), activations_, gradient_);
  s.adam.step(s.parameters, gradient_, learning_rate);
  return sum;
}

Matrix Mlp::predict(const Matrix& inputs) const { return maps_of(inputs, parameters_); }

Matrix Mlp::maps_of(const Matrix& inputs, const std::vector<float>& parameters) const {
  Activations<float> activations;
  forward(network_, parameters, inputs.values.data(), inputs.rows, activations);
  Matrix out;
  out.rows = inputs.rows, out.cols = centre_.size();
  out.values = std::move(activations.back());
  for (std::size_t i = 0; i < out.rows; ++i)
    for (std::size_t p = 0; p < out.cols; ++p) out.row(i)[p] = centre_[p] + spread_ * out.row(i)[p];
  return out;
}

double Mlp::rmse(const Samples& samples, const std::vector<float>& parameters) const {
  const Matrix maps = maps_of(take_rows(samples.inputs, samples.rows), parameters);
  double sum = 0;
  for (std::size_t i = 0; i < maps.rows; ++i)
    for (std::size_t p = 0; p < maps.cols; ++p)
      sum += std::pow(double{maps.row(i)[p]} - double{samples.maps.row(samples.rows[i])[p]}, 2);
  return std::sqrt(sum / static_cast<double>(maps.values.size()));
}

void Mlp::save(record::H5File& file) const {
  file.write("model/centre_m", centre_, {centre_.size()});
  file.set("model/centre_m", "spread_m", double{spread_});
  for (std::size_t l = 0; l < network_.layers.size(); ++l) {
    const Layer& layer = network_.layers[l];
    const std::string name = "model/layer" + std::to_string(l);
    const std::span<const float> all(parameters_);
    file.write(name + "/weights", all.subspan(layer.weights, layer.inputs * layer.outputs),
               {layer.inputs, layer.outputs});
    file.write(name + "/biases", all.subspan(layer.biases, layer.outputs), {layer.outputs});
  }
}

void Mlp::load(const record::H5File& file) {
  centre_ = file.read<float>("model/centre_m");
  spread_ = static_cast<float>(file.get<double>("model/centre_m", "spread_m"));
  widths_.clear();
  parameters_.clear();
  for (std::size_t l = 0;; ++l) {
    const std::string name = "model/layer" + std::to_string(l);
    if (!file.has(name + "/weights")) break;
    const auto shape = file.shape(name + "/weights");
    if (l == 0) widths_.push_back(shape.at(0));
    widths_.push_back(shape.at(1));
    for (const char* part : {"/weights", "/biases"}) {
      const auto values = file.read<float>(name + part);
      parameters_.insert(parameters_.end(), values.begin(), values.end());
    }
  }
  network_ = make_network(widths_);
}

}  // namespace

std::unique_ptr<Model> make_mlp() { return std::make_unique<Mlp>(); }

}  // namespace echofuse::recon
