// SPDX-License-Identifier: MIT
// A network fitted by least squares to a table of targets. It learns the difference to their mean
// in units of their spread, so that training starts from the mean.
#pragma once
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/models/network/adam.hpp"
#include "recon/models/network/network.hpp"
#include "recon/models/network/training.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// Row i of both tables is one example; `rows` are those to use.
struct Examples {
  const Matrix& inputs;
  const Matrix& targets;
  const Rows& rows;
};

// What an error in one target weighs: the same number in every column (pixels of one map), or in
// each column as many of its own standard deviations (numbers of different kinds).
enum class Spread : bool { common, each };

// Puts other examples of the same kind in place of these: as they are drawn anew in each epoch, the
// copies take no memory. Row i of both tables is example rows[i]; the random numbers are the
// training's own.
using Redraw = std::function<void(std::span<const std::size_t> rows, Matrix& inputs,
                                  Matrix& targets, Rng& rng)>;

struct Training {
  std::vector<std::size_t> hidden;  // width of each hidden layer
  std::size_t epochs, patience;
  double learning_rate, weight_decay;  // the rate at first; it falls to nothing
  std::size_t batch;
  std::uint64_t seed;
  bool quiet;
  Redraw redraw = {};               // none: the examples as they are
  std::vector<float> weights = {};  // of each column's squared errors; none: 1
  double pull = 0;                  // weight of half the squared distance from the first weights
};

Training training_of(const Tuning& tuning, std::size_t records);
// Of options that candidate_of has filled.
Training training_of(const FitOptions& options);

struct TrainingState {
  std::vector<float> parameters, best;  // now, and of the best epoch
  Adam adam;
  Rows order;  // of the records in this epoch
  Rng order_rng, redraw_rng;
  TrainingLog log;
  double least;                    // validation loss of the best epoch
  std::size_t epoch = 0, row = 0;  // done: whole epochs, and records of this one
  double squares = 0;              // sum of squared errors of those records
};

class Regression {
 public:
  // The log is in units of the targets (common) or of their standard deviations (each). `title`
  // and `unit` are for the progress line. Throws Error(failed) if training diverges.
  TrainingLog fit(const Examples& train, const Examples& validation, Spread spread,
                  const Training& training, const std::string& title, const std::string& unit);
  // Goes on from the weights that it has, with their scaling: all epochs, unless interrupted; it
  // is left as it was then. First moves its answers by part of their mean error (Tuning::belief).
  void tune(const Examples& train, const Training& training, const std::string& title);
  Matrix predict(const Matrix& inputs) const;
  Cost cost() const { return {network_.weights, network_.parameters}; }
  std::vector<std::size_t> hidden() const;  // width of each hidden layer
  void archive(Archive archive, std::size_t inputs, std::size_t outputs);

 private:
  void standardise(const Examples& train, Spread spread, const std::vector<float>& weights);
  void train_epoch(const Examples& train, const Training& training, TrainingState& s);
  void move_centre(const Examples& train);
  void pull_back(const std::vector<float>& parameters, float pull);
  double train_batch(const Examples& train, std::span<const std::size_t> rows,
                     const Training& training, TrainingState& s, double learning_rate);
  void judge(const Examples& validation, TrainingState& s, const std::string& title);
  Matrix outputs_of(const Matrix& inputs, const std::vector<float>& parameters) const;
  double rms_error(const Examples& examples, const std::vector<float>& parameters) const;

  Network network_;
  std::vector<float> parameters_;
  std::vector<float> centre_, spread_;   // per column, in units of the targets
  double unit_ = 1;                      // of the log
  Matrix batch_inputs_, batch_targets_;  // scratch of train_batch
  Activations<float> activations_;
  std::vector<float> gradient_;
};

}  // namespace echofuse::recon
