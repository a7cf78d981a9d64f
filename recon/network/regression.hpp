// SPDX-License-Identifier: MIT
// Fits a network to a table of targets by least squares. The network predicts the difference from
// their mean in units of their spread, so that training starts from the mean.
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

// Row i of both tables is one example; `rows` selects the examples in use.
struct Examples {
  const Matrix& inputs;
  const Matrix& targets;
  const Rows& rows;
};

// Unit of an error: common to all columns (pixels of a map), or each column's standard deviation.
enum class Spread : bool { common, each };

// Data augmentation: replaces a batch of examples by random variants, different in each epoch,
// without memory for copies. Row i of both tables is example rows[i]; `rng` is the training's
// random stream.
using Redraw = std::function<void(std::span<const std::size_t> rows, Matrix& inputs,
                                  Matrix& targets, Rng& rng)>;

// Loss that replaces the squared error.
struct Loss {
  std::vector<float> centre, spread;  // output = centre + spread x network output
  // Replaces the outputs by the loss's slopes and returns the loss. Threading: any thread.
  std::function<double(std::span<const float> target, std::span<float> outputs)> to_slopes;
};

struct Training {
  std::vector<std::size_t> hidden;  // width of each hidden layer
  std::size_t epochs, patience;
  double learning_rate, weight_decay;  // initial rate; decreases to zero
  std::size_t batch;
  std::uint64_t seed;
  bool quiet;
  Redraw redraw = {};               // empty: no augmentation
  std::vector<float> weights = {};  // weight of each column's squared errors; empty: 1
  double l2_penalty = 0;            // weight of half the squared distance from the initial weights
  Loss loss = {};                   // without to_slopes: squared error
};

Training training_of(const Tuning& tuning, std::size_t records);
// Requires options completed by candidate_of().
Training training_of(const FitOptions& options);

struct TrainingState {
  std::vector<float> parameters, best;  // current parameters, and those of the best epoch
  Adam adam;
  Rows order;  // order of the records in this epoch
  Rng order_rng, redraw_rng;
  TrainingLog log;
  double least;                    // validation loss of the best epoch
  std::size_t epoch = 0, row = 0;  // completed epochs, and records done in the current one
  double squares = 0;              // sum of squared errors of these records
};

class Regression {
 public:
  // Logs in units of the targets (common) or of their standard deviations (each); for a custom
  // loss, the root of its mean. Calls on_epoch after each epoch. If training diverges, throws
  // Error(failed) with a text that begins with the title.
  using OnEpoch = std::function<void(std::size_t epochs, double validation_loss)>;
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  const Training& training, const std::string& title, const OnEpoch& on_epoch = {});
  // Shifts the outputs by part of their median error, and scales them by part of the median slope
  // (Tuning::shrinkage).
  void correct(const Examples& train);
  // Continues training from the current weights, with their scaling. Shifts the outputs by part of
  // their mean error first. Trains all epochs or until an interrupt.
  void tune(const Examples& train, const Training& training, const std::string& title);
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const { return {network_.weights, network_.parameters}; }
  std::vector<std::size_t> hidden() const;  // width of each hidden layer
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
  std::vector<float> centre_, spread_;   // per column, in units of the targets
  double unit_ = 1;                      // unit of the log
  Matrix batch_inputs_, batch_targets_;  // scratch memory of train_batch
  Activations<float> activations_;
  std::vector<float> gradient_;
};

}  // namespace echofuse::recon
