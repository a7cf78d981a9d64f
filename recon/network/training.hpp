// SPDX-License-Identifier: MIT
// Options and results of a training.
#pragma once
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::recon {

// Options that are not given take the kind's own values (ModelKind::own).
struct FitOptions {
  std::optional<std::vector<std::size_t>> hidden = {};  // mlp: width of each hidden layer
  std::optional<std::size_t> basis = {};  // pca, factorised: components; nearest: records
  std::optional<std::size_t> epochs = {};
  std::optional<double> learning_rate = {}, weight_decay = {};
  // Training stops after so many epochs without a better validation loss.
  std::optional<std::size_t> patience = {};
  std::optional<std::size_t> batch = {};
  std::uint64_t seed = 1;
  bool quiet = false;
};

// Root mean square errors, one entry an epoch; empty for models that are fitted in one step. Units:
// metres for an mlp, amounts of the components for a pca-mlp. A factorised model has those of the
// place, in units of its spread.
struct TrainingLog {
  std::vector<double> loss, validation_loss;
  std::size_t best_epoch = 0;  // kept epoch, counted from 1; 0: none beat the mean
  bool interrupted = false;
};

// Options of fine-tuning: how a trained model is taken to the records of another room.
struct Tuning {
  // L2 penalty to the old weights: weight of the mean squared distance from them, times the number
  // of records. INFINITY leaves the networks unchanged.
  double l2_penalty = 1;
  // With networks that stay, a model that places a body still learns its mean body. Also learns the
  // offset and scale of its places.
  bool correct = false;
  std::size_t steps = 200, batch = 64;  // a step takes at most so many records
  double learning_rate = 4e-3;          // the first rate; it falls to zero
  std::uint64_t seed = 1;
  bool networks_stay() const { return std::isinf(l2_penalty); }
  // Factor, 0 to 1, by which a residual's mean over so few records shrinks before it corrects.
  static double belief(std::size_t records) {
    return static_cast<double>(records) / static_cast<double>(records + 10);
  }
};

struct Cost {
  std::size_t multiply_adds = 0;  // for one map
  std::size_t parameters = 0;
  Cost& operator+=(const Cost& other) {
    multiply_adds += other.multiply_adds, parameters += other.parameters;
    return *this;
  }
};

}  // namespace echofuse::recon
