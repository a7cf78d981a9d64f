// SPDX-License-Identifier: MIT
// Options and results of a training.
#pragma once
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::recon {

// Missing options take the defaults of the model kind (ModelKind::own).
struct FitOptions {
  std::optional<std::vector<std::size_t>> hidden = {};  // mlp: width of each hidden layer
  std::optional<std::size_t> basis = {};  // pca, factorised: components; nearest: records
  std::optional<std::size_t> epochs = {};
  std::optional<double> learning_rate = {}, weight_decay = {};
  // epochs without a better validation loss before training stops
  std::optional<std::size_t> patience = {};
  std::optional<std::size_t> batch = {};
  std::uint64_t seed = 1;
  bool quiet = false;
};

// Root mean square errors, one entry per epoch; empty for models fitted in one step. Units: metres
// for an mlp, coefficients of the components for a pca-mlp, units of the position's spread for a
// factorised model.
struct TrainingLog {
  std::vector<double> loss, validation_loss;
  std::size_t best_epoch = 0;  // kept epoch, counted from 1; 0: none beat the mean
  bool interrupted = false;
};

// Options of fine-tuning: the adaptation of a trained model to records of another room.
struct Tuning {
  // Weight of the mean squared distance from the old weights, times the number of records. INFINITY
  // keeps the networks unchanged.
  double l2_penalty = 1;
  // With unchanged networks a model that places a body still learns the new mean body. True: it
  // also learns offset and scale of the positions.
  bool correct = false;
  std::size_t steps = 200, batch = 64;  // a step uses at most `batch` records
  double learning_rate = 4e-3;          // initial rate; decreases to zero
  std::uint64_t seed = 1;
  bool networks_stay() const { return std::isinf(l2_penalty); }
  // Factor, 0 to 1, that shrinks the mean residual of this number of records before its use as a
  // correction.
  static double shrinkage(std::size_t records) {
    return static_cast<double>(records) / static_cast<double>(records + 10);
  }
};

struct Cost {
  std::size_t multiply_adds = 0;  // per map
  std::size_t parameters = 0;
  Cost& operator+=(const Cost& other) {
    multiply_adds += other.multiply_adds, parameters += other.parameters;
    return *this;
  }
};

}  // namespace echofuse::recon
