// SPDX-License-Identifier: MIT
// Fits a network to a table of targets by least squares. The network predicts the difference from
// the mean of the targets in units of their spread, so that training starts from the mean.
#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/network/adam.hpp"
#include "recon/network/network.hpp"
#include "recon/network/training.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// Examples for a fit: row i of `inputs` and row i of `targets` are one example. `rows` lists the
// examples to use.
struct Examples {
  const Matrix& inputs;
  const Matrix& targets;
  const Rows& rows;
};

// Unit of errors. common: one unit for all columns, e.g. the pixels of a map. each: the unit of
// each column is the standard deviation of that column.
enum class Spread : bool { common, each };

// Data augmentation: replaces a batch of examples by random variants, which differ in each epoch
// and need no memory for copies. Row i of `inputs` and `targets` is example rows[i]; `rng` is the
// random stream to use for the variants.
using Redraw = std::function<void(std::span<const std::size_t> rows, Matrix& inputs,
                                  Matrix& targets, Rng& rng)>;

// Custom loss, used instead of the squared error.
struct Loss {
  // The output of column c is centre[c] + spread[c] x network output.
  std::vector<float> centre, spread;
  // Replaces a row of outputs by the derivatives of the loss and returns the loss. Threading: must
  // be callable from any thread.
  std::function<double(std::span<const float> target, std::span<float> outputs)> to_slopes;
};

struct Training {
  std::vector<std::size_t> hidden;  // width of each hidden layer
  std::size_t epochs, patience;
  double learning_rate, weight_decay;  // learning_rate: initial value, which decreases to zero
  std::size_t batch;
  std::uint64_t seed;
  bool quiet;
  Redraw redraw = {};  // if empty, no augmentation is used
  // Weight of the squared errors of each column; if empty, all weights are 1.
  std::vector<float> weights = {};
  // Weight of the L2 penalty. The penalty is half the squared distance of the network weights from
  // their initial values.
  double l2_penalty = 0;
  Loss loss = {};  // custom loss; if `to_slopes` is empty, the squared error is used
};

Training training_of(const Tuning& tuning, std::size_t records);
// Returns the training options; all values must have been set (candidate_of() does this).
Training training_of(const FitOptions& options);

struct TrainingState {
  std::vector<float> parameters, best;
  Adam adam;
  Rows order;  // order of the records in this epoch
  Rng order_rng, redraw_rng;
  TrainingLog log;
  double lowest_loss;  // lowest validation loss so far
  // Number of completed epochs, and of records processed in the current epoch.
  std::size_t epoch = 0, row = 0;
  double squares = 0;  // sum of the squared errors in the current epoch
};

class Regression {
 public:
  // fit() trains the network. It logs losses in units of the targets (Spread::common) or of their
  // standard deviations (Spread::each). A custom loss is logged as the square root of its mean.
  // fit() calls `on_epoch` after each epoch. It throws Error(failed) if training diverges; the
  // message begins with the title.
  using OnEpoch = std::function<void(std::size_t epochs, double validation_loss)>;
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  const Training& training, const std::string& title, const OnEpoch& on_epoch = {});
  // Adapts the offset and the scale of the outputs to other records: adds the median error to the
  // outputs, and multiplies them by the median slope of the targets as a function of the outputs.
  // Both corrections are reduced by Tuning::shrinkage().
  void correct(const Examples& train);
  // Continues training from the current weights, with the current scaling. First adds the mean
  // error, reduced by Tuning::shrinkage(), to the outputs. Does not stop early. After an interrupt,
  // the previous weights are kept.
  void tune(const Examples& train, const Training& training, const std::string& title);
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const { return {network_.weights, network_.parameters}; }
  std::vector<std::size_t> hidden() const;
  void archive(Archive archive, std::size_t inputs, std::size_t outputs);

 private:
  void standardise(const Examples& train, Spread spread, const std::vector<float>& weights);
  void train_epoch(const Examples& train, const Training& training, TrainingState& s);
  void move_centre(const Examples& train);
  void shrink_to_start(const std::vector<float>& parameters, float l2_penalty);
  double train_batch(const Examples& train, std::span<const std::size_t> rows,
                     const Training& training, TrainingState& s, double learning_rate);
  void end_epoch(const Examples& validation, const Loss& loss, TrainingState& s,
                 const std::string& title);
  Matrix outputs_of(const Matrix& inputs, const std::vector<float>& parameters) const;
  double rms_error(const Examples& examples, const Loss& loss,
                   const std::vector<float>& parameters) const;
  double to_slopes(const Loss& loss, std::span<const float> target, std::span<float> outputs,
                   float times) const;

  Network network_;
  std::vector<float> parameters_;
  std::vector<float> centre_, spread_;   // mean and scale of each column, in units of the targets
  double unit_ = 1;                      // factor that converts a network error to a logged loss
  Matrix batch_inputs_, batch_targets_;  // scratch memory of train_batch()
  Activations<float> activations_;
  std::vector<float> gradient_;
};

}  // namespace echofuse::recon
