// SPDX-License-Identifier: MIT
// Fits a network by least squares to a table of targets. The network learns the difference to their
// mean in units of their spread, so that training starts from the mean.
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

// Row i of both tables is one example; `rows` are those to use.
struct Examples {
  const Matrix& inputs;
  const Matrix& targets;
  const Rows& rows;
};

// Unit of an error: the same for all columns (pixels of one map), or each column's standard
// deviation.
enum class Spread : bool { common, each };

// Replaces these examples by others of the same kind, anew in each epoch, so that copies take no
// memory. Row i of both tables is example rows[i]; the random numbers are the training's own.
using Redraw = std::function<void(std::span<const std::size_t> rows, Matrix& inputs,
                                  Matrix& targets, Rng& rng)>;

// A loss takes the place of the squared error between outputs and targets.
struct Loss {
  std::vector<float> centre, spread;  // an output is centre + spread x that of the network
  // Replaces the outputs by the loss's slopes and returns the loss. Threading: any thread.
  std::function<double(std::span<const float> target, std::span<float> outputs)> to_slopes;
};

struct Training {
  std::vector<std::size_t> hidden;  // width of each hidden layer
  std::size_t epochs, patience;
  double learning_rate, weight_decay;  // the rate at first; it falls to nothing
  std::size_t batch;
  std::uint64_t seed;
  bool quiet;
  Redraw redraw = {};               // if empty, the examples stay as they are
  std::vector<float> weights = {};  // weights of each column's squared errors; if empty, all are 1
  double l2_penalty = 0;            // weight of half the squared distance from the first weights
  Loss loss = {};                   // without to_slopes: squared errors
};

Training training_of(const Tuning& tuning, std::size_t records);
// The options are those that candidate_of has filled.
Training training_of(const FitOptions& options);

struct TrainingState {
  std::vector<float> parameters, best;  // the present ones, and those of the best epoch
  Adam adam;
  Rows order;  // order of the records in this epoch
  Rng order_rng, redraw_rng;
  TrainingLog log;
  double least;                    // validation loss of the best epoch
  std::size_t epoch = 0, row = 0;  // whole epochs that are done, and records of the present one
  double squares = 0;              // sum of squared errors of those records
};

class Regression {
 public:
  // The log is in units of the targets (common) or of their standard deviations (each); of a loss
  // of its own the root of the mean. `told` takes the epochs that are done and the validation loss.
  // Throws Error(failed), which begins with the title, if training diverges.
  using Told = std::function<void(std::size_t epochs, double validation_loss)>;
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  const Training& training, const std::string& title, const Told& told = {});
  // Moves the answers by part of their median error, and scales them by part of the median slope
  // (Tuning::belief).
  void correct(const Examples& train);
  // Trains on from the present weights, with their scaling. Moves the answers by part of their mean
  // error, then trains all epochs, or until an interrupt.
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
  void judge(const Examples& validation, const Loss& loss, TrainingState& s,
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
  Matrix batch_inputs_, batch_targets_;  // scratch of train_batch
  Activations<float> activations_;
  std::vector<float> gradient_;
};

}  // namespace echofuse::recon
