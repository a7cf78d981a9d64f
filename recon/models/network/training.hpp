// SPDX-License-Identifier: MIT
// What a training is told, and what it tells.
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
  // Epochs without a better validation loss before stopping.
  std::optional<std::size_t> patience = {};
  std::optional<std::size_t> batch = {};
  std::uint64_t seed = 1;
  bool quiet = false;
};

// One entry an epoch; empty for models that are fitted in one step. Root mean square errors: of an
// mlp in metres, of a pca-mlp in amounts of the components, of a factorised model of the place, in
// units of its spread.
struct TrainingLog {
  std::vector<double> loss, validation_loss;
  std::size_t best_epoch = 0;  // whose weights were kept, counted from 1; 0: none beat the mean
  bool interrupted = false;
};

// How a trained model is taken to the records of another room.
struct Tuning {
  // Weight of the mean squared distance from the weights that it came with, times the number of
  // records; INFINITY: the networks stay as they are.
  double pull = 1;
  // Of models that place a body: turn the bodies (method/turned.hpp). Of few records that does
  // harm.
  bool turn = false;
  std::size_t steps = 200, batch = 64;  // at most so many records a step
  double learning_rate = 4e-3;          // at first; it falls to nothing
  std::uint64_t seed = 1;
  bool networks_stay() const { return std::isinf(pull); }
  // Of a mean residual over so many records, how much is believed.
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
