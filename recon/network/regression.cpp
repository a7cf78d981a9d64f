// SPDX-License-Identifier: MIT
#include "recon/network/regression.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "drivers/util/console.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// redraw_stream: "turn" in ASCII
constexpr std::uint64_t weight_stream = 1, order_stream = 2, redraw_stream = 0x7475726e;

// Returns the learning rate at a fraction `progress` of the training: cosine annealing from `rate`
// to zero (Loshchilov and Hutter, ICLR 2017).
double annealed(double rate, double progress) {
  return rate * 0.5 * (1 + std::cos(M_PI * progress));
}

double square(double v) { return v * v; }

// Targets of one row, with mean (centre) and 1 / spread (per_spread) of each column. `times`:
// factor that converts an error to the derivative of the loss.
struct RowTargets {
  const float *truth, *centre, *per_spread;
  float times;
};

// Replaces a row of outputs by the derivatives of the squared error, and returns the sum of the
// squared errors, in units of the spread.
double to_slopes(const RowTargets& row_targets, std::size_t columns, float* outputs) {
  const auto count = static_cast<Eigen::Index>(columns);
  const auto row = [&](const float* values) {
    return Eigen::Map<const Eigen::ArrayXf>(values, count);
  };
  Eigen::Map<Eigen::ArrayXf> errors(outputs, count);
  errors -= (row(row_targets.truth) - row(row_targets.centre)) * row(row_targets.per_spread);
  const double sum = double{errors.square().sum()};
  errors *= row_targets.times;
  return sum;
}

constexpr std::size_t part_values = 1 << 16;  // number of output values in one part of a batch
constexpr double max_value = 1e18;            // largest value allowed in a model file

bool sound(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(),
                     [](float v) { return std::abs(v) <= static_cast<float>(max_value); });
}

}  // namespace

Training training_of(const FitOptions& o) {
  return {o.hidden.value_or(std::vector<std::size_t>{}),
          o.epochs.value(),
          o.patience.value(),
          o.learning_rate.value(),
          o.weight_decay.value(),
          o.batch.value(),
          o.seed,
          o.quiet,
          {},
          {}};
}

// Returns the training options for this number of records. All batches have nearly the same size,
// because a small last batch would make a noisy step.
Training training_of(const Tuning& t, std::size_t records) {
  const std::size_t a_pass = std::max<std::size_t>(1, (records + t.batch - 1) / t.batch);
  Training out{};
  out.epochs = std::max<std::size_t>(1, t.steps / a_pass);
  out.learning_rate = t.learning_rate;
  out.batch = (records + a_pass - 1) / a_pass;
  out.seed = t.seed;
  out.quiet = true;
  out.l2_penalty = t.l2_penalty / static_cast<double>(records);
  return out;
}

void Regression::standardise(const Examples& train, Spread spread,
                             const std::vector<float>& weights) {
  auto [mean, squares] = column_statistics(train.targets, train.rows);
  if (spread == Spread::common) {
    double all = 0;
    for (const double s : squares) all += s / static_cast<double>(squares.size());
    std::fill(squares.begin(), squares.end(), all);
  }
  centre_.assign(mean.begin(), mean.end());
  spread_.assign(squares.size(), 1);
  for (std::size_t c = 0; c < squares.size(); ++c)
    if (squares[c] > 0) spread_[c] = static_cast<float>(std::sqrt(squares[c]));
  for (std::size_t c = 0; c < weights.size(); ++c) spread_[c] /= std::sqrt(weights[c]);
  unit_ = spread == Spread::common ? double{spread_.front()} : 1;
}

TrainingLog Regression::fit(const Examples& train, const Examples& validation, Spread spread,
                            const Training& training, const std::string& title,
                            const OnEpoch& on_epoch) {
  if (training.loss.to_slopes)
    centre_ = training.loss.centre, spread_ = training.loss.spread, unit_ = 1;
  else
    standardise(train, spread, training.weights);
  std::vector<std::size_t> widths{train.inputs.cols};
  widths.insert(widths.end(), training.hidden.begin(), training.hidden.end());
  widths.push_back(centre_.size());
  network_ = make_network(widths);
  Rng weight_rng = make_rng(training.seed, weight_stream);
  TrainingState s{.parameters = initial_parameters(network_, weight_rng),
                  .best = {},
                  .adam = Adam(network_.parameters, training.weight_decay),
                  .order = train.rows,
                  .order_rng = make_rng(training.seed, order_stream),
                  .redraw_rng = make_rng(training.seed, redraw_stream),
                  .log = {},
                  .lowest_loss = max_value};
  s.best = s.parameters;
  // The initial weights predict the mean of the targets. These weights are kept unless an epoch has
  // a lower validation loss.
  if (!validation.rows.empty()) s.lowest_loss = rms_error(validation, training.loss, s.parameters);
  while (s.epoch < training.epochs && s.epoch - s.log.best_epoch < training.patience) {
    train_epoch(train, training, s);
    const bool broken = interrupted();
    if (s.row == 0) break;
    end_epoch(validation, training.loss, s, title);
    if (on_epoch) on_epoch(s.epoch, s.log.validation_loss.back());
    if (broken) break;
  }
  s.log.interrupted = interrupted();
  parameters_ = std::move(s.best);
  return s.log;
}

void Regression::tune(const Examples& train, const Training& training, const std::string& title) {
  move_centre(train);
  TrainingState s{.parameters = parameters_,
                  .best = {},
                  .adam = Adam(network_.parameters, 0),
                  .order = train.rows,
                  .order_rng = make_rng(training.seed, order_stream),
                  .redraw_rng = make_rng(training.seed, redraw_stream),
                  .log = {},
                  .lowest_loss = max_value};
  for (; s.epoch < training.epochs && !interrupted(); ++s.epoch, s.row = 0)
    train_epoch(train, training, s);
  if (!sound(s.parameters))
    throw Error(ExitCode::failed, title + " diverged: weights are not finite after fine-tuning");
  if (!interrupted()) parameters_ = std::move(s.parameters);
}

// Estimates the slope of the targets as a function of the outputs: the median over pairs of records
// (Theil, Indagationes Math. 12, 85, 1950). Medians are robust against the few bodies that are
// placed on the wrong side.
void Regression::correct(const Examples& train) {
  constexpr double min_scale = 0.5, max_scale = 2;
  const Matrix found = predict(take_rows(train.inputs, train.rows));
  const double share = Tuning::shrinkage(found.rows);
  // Maximum number of paired records; more would hardly change a median.
  constexpr std::size_t max_paired = 500;
  const std::size_t step = found.rows / max_paired + 1;
  for (std::size_t c = 0; c < centre_.size() && found.rows > 2; ++c) {
    const auto answer = [&](std::size_t i) { return found.row(i)[c]; };
    const auto target = [&](std::size_t i) { return train.targets.row(train.rows[i])[c]; };
    std::vector<float> slopes, offsets, answers;
    for (std::size_t i = 0; i < found.rows; ++i) {
      offsets.push_back(target(i) - answer(i)), answers.push_back(answer(i));
      for (std::size_t j = 0; i % step == 0 && j < i; j += step)
        if (answer(i) != answer(j))
          slopes.push_back((target(i) - target(j)) / (answer(i) - answer(j)));
    }
    if (slopes.empty()) continue;
    const double slope = std::clamp(double{quantile(slopes, 0.5)}, min_scale, max_scale);
    const double scale = 1 + share * (slope - 1);
    spread_[c] *= static_cast<float>(scale);
    centre_[c] += static_cast<float>((1 - scale) * double{quantile(answers, 0.5) - centre_[c]} +
                                     share * double{quantile(offsets, 0.5)});
  }
}

void Regression::move_centre(const Examples& train) {
  const Matrix found = predict(take_rows(train.inputs, train.rows));
  std::vector<double> sum(centre_.size());
  for (std::size_t i = 0; i < found.rows; ++i)
    for (std::size_t c = 0; c < sum.size(); ++c)
      sum[c] += double{train.targets.row(train.rows[i])[c]} - double{found.row(i)[c]};
  const double share = Tuning::shrinkage(found.rows) / static_cast<double>(found.rows);
  for (std::size_t c = 0; c < sum.size(); ++c) centre_[c] += static_cast<float>(share * sum[c]);
}

// Adds the gradient of the L2 penalty, which pulls the weights towards their values before
// training.
void Regression::shrink_to_start(const std::vector<float>& parameters, float l2_penalty) {
  for (std::size_t i = 0; i < parameters.size(); ++i)
    gradient_[i] += l2_penalty * (parameters[i] - parameters_[i]);
}

// Trains until the epoch ends or the user interrupts the training.
void Regression::train_epoch(const Examples& train, const Training& training, TrainingState& s) {
  std::shuffle(s.order.begin(), s.order.end(), s.order_rng);
  const std::span<const std::size_t> rows(s.order);
  while (s.row < rows.size() && !interrupted()) {
    const std::size_t count = std::min(training.batch, rows.size() - s.row);
    const double done = static_cast<double>(s.epoch) +
                        static_cast<double>(s.row) / static_cast<double>(rows.size());
    const double rate =
        annealed(training.learning_rate, done / static_cast<double>(training.epochs));
    s.squares += train_batch(train, rows.subspan(s.row, count), training, s, rate);
    s.row += count;
  }
}

// Ends the epoch: logs the losses, and stores the weights if their validation loss is the lowest so
// far.
void Regression::end_epoch(const Examples& validation, const Loss& loss, TrainingState& s,
                           const std::string& title) {
  const double values = static_cast<double>(std::max<std::size_t>(s.row, 1) * centre_.size());
  s.log.loss.push_back(std::sqrt(s.squares / values) * unit_);
  // If there are no validation records, the last epoch counts as the best.
  const bool unvalidated = validation.rows.empty();
  const double score =
      unvalidated ? -static_cast<double>(s.epoch) : rms_error(validation, loss, s.parameters);
  // Checks the weights as well, because the loss was computed before the last step.
  if (!(s.log.loss.back() <= max_value && score <= max_value) || !sound(s.parameters))
    throw Error(ExitCode::failed, title + " diverged in epoch " + std::to_string(s.epoch + 1) +
                                      ": weights are not finite; use a smaller "
                                      "learning_rate");
  s.log.validation_loss.push_back(unvalidated ? s.log.loss.back() : score);
  ++s.epoch, s.row = 0, s.squares = 0;
  if (score < s.lowest_loss)
    s.lowest_loss = score, s.best = s.parameters, s.log.best_epoch = s.epoch;
}

// Makes one training step, and returns the sum of the squared errors, in units of the spread.
double Regression::train_batch(const Examples& train, std::span<const std::size_t> rows,
                               const Training& training, TrainingState& s, double learning_rate) {
  batch_inputs_ = take_rows(train.inputs, {rows.begin(), rows.end()});
  if (training.redraw) {
    batch_targets_ = take_rows(train.targets, {rows.begin(), rows.end()});
    training.redraw(rows, batch_inputs_, batch_targets_, s.redraw_rng);
  }
  const float* x = batch_inputs_.values.data();
  forward(network_, s.parameters, x, rows.size(), activations_);
  auto& output = activations_.back();
  const std::size_t columns = centre_.size();
  const float per_value = 1.f / static_cast<float>(rows.size() * columns);
  std::vector<float> per_spread(columns);
  for (std::size_t c = 0; c < columns; ++c) per_spread[c] = 1 / spread_[c];
  std::vector<double> squares(rows.size());
  const std::size_t part_rows = std::max<std::size_t>(1, part_values / columns);
  for_each_part((rows.size() + part_rows - 1) / part_rows, [&](std::size_t part) {
    const std::size_t first = part * part_rows, last = std::min(first + part_rows, rows.size());
    for (std::size_t i = first; i < last; ++i) {
      const auto truth = training.redraw ? batch_targets_.row(i) : train.targets.row(rows[i]);
      float* const row = output.data() + i * columns;
      squares[i] =
          training.loss.to_slopes
              ? to_slopes(training.loss, truth, {row, columns}, per_value)
              : recon::to_slopes({truth.data(), centre_.data(), per_spread.data(), 2 * per_value},
                                 columns, row);
    }
  });
  backward(network_, s.parameters, x, rows.size(), activations_, gradient_);
  if (training.l2_penalty > 0)
    shrink_to_start(s.parameters, static_cast<float>(training.l2_penalty));
  s.adam.step(s.parameters, gradient_, learning_rate);
  return std::accumulate(squares.begin(), squares.end(), 0.0);
}

Matrix Regression::predict(const Matrix& inputs) const { return outputs_of(inputs, parameters_); }

Matrix Regression::outputs_of(const Matrix& inputs, const std::vector<float>& parameters) const {
  Activations<float> activations;
  forward(network_, parameters, inputs.values.data(), inputs.rows, activations);
  Matrix out;
  out.rows = inputs.rows, out.cols = centre_.size();
  out.values = std::move(activations.back());
  for (std::size_t i = 0; i < out.rows; ++i)
    for (std::size_t c = 0; c < out.cols; ++c)
      out.row(i)[c] = centre_[c] + spread_[c] * out.row(i)[c];
  return out;
}

// Replaces a row of network outputs by the derivatives of a custom loss, multiplied by a factor,
// and returns the loss.
double Regression::to_slopes(const Loss& loss, std::span<const float> target,
                             std::span<float> outputs, float times) const {
  for (std::size_t c = 0; c < outputs.size(); ++c)
    outputs[c] = centre_[c] + spread_[c] * outputs[c];
  const double value = loss.to_slopes(target, outputs);
  for (std::size_t c = 0; c < outputs.size(); ++c) outputs[c] *= spread_[c] * times;
  return value;
}

double Regression::rms_error(const Examples& examples, const Loss& loss,
                             const std::vector<float>& parameters) const {
  Matrix found = outputs_of(take_rows(examples.inputs, examples.rows), parameters);
  double sum = 0;
  for (std::size_t i = 0; i < found.rows && loss.to_slopes; ++i)
    sum += loss.to_slopes(examples.targets.row(examples.rows[i]), found.row(i));
  if (loss.to_slopes) return std::sqrt(sum / static_cast<double>(found.values.size()));
  for (std::size_t i = 0; i < found.rows; ++i)
    for (std::size_t c = 0; c < found.cols; ++c)
      sum += square((double{found.row(i)[c]} - double{examples.targets.row(examples.rows[i])[c]}) /
                    double{spread_[c]});
  return std::sqrt(sum / static_cast<double>(found.values.size())) * unit_;
}

std::vector<std::size_t> Regression::hidden() const {
  std::vector<std::size_t> out;
  for (std::size_t l = 0; l + 1 < network_.layers.size(); ++l)
    out.push_back(network_.layers[l].outputs);
  return out;
}

void Regression::archive(Archive archive, std::size_t inputs, std::size_t outputs) {
  archive.values("centre", centre_, outputs);
  archive.values("spread", spread_, outputs);
  recon::archive(archive, network_, parameters_, inputs, outputs);
}

}  // namespace echofuse::recon
