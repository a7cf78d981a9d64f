// SPDX-License-Identifier: MIT
#pragma once
#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::recon {

// Options of a fit. Missing values are replaced by the defaults of the model kind (ModelKind::own).
struct FitOptions {
  std::optional<std::vector<std::size_t>> hidden = {};  // mlp: width of each hidden layer
  // pca, factorised: number of components; nearest: number of nearest records.
  std::optional<std::size_t> basis = {};
  std::optional<std::size_t> epochs = {};
  std::optional<double> learning_rate = {}, weight_decay = {};
  // Training stops after this number of epochs without a lower validation loss.
  std::optional<std::size_t> patience = {};
  std::optional<std::size_t> batch = {};
  std::uint64_t seed = 1;
  bool quiet = false;
};

// Root mean square error of each epoch; empty for models that are fitted in one step. Units: metres
// for mlp, coefficients of the components for pca-mlp, standard deviations of the position for
// factorised.
struct TrainingLog {
  std::vector<double> loss, validation_loss;
  // Epoch that the kept weights come from, counted from 1; 0 if no epoch was better than predicting
  // the mean of the targets.
  std::size_t best_epoch = 0;
  bool interrupted = false;
};

// Options of fine-tuning, which adapts a trained model to records of another room.
struct Tuning {
  // L2 penalty: the mean loss is increased by l2_penalty / records times half the squared distance
  // between the new and the old weights. INFINITY keeps the networks unchanged.
  double l2_penalty = 1;
  // Used only if the networks stay unchanged. If true, a model that predicts a body position fits
  // the offset and scale of the positions, and the mean body, to the new records.
  bool correct = false;
  std::size_t steps = 200, batch = 64;  // number of steps, and maximum number of records per step
  double learning_rate = 4e-3;          // initial learning rate, which decreases to zero
  std::uint64_t seed = 1;
  bool networks_stay() const { return std::isinf(l2_penalty); }
  // Returns n / (n + 10), the factor by which the mean residual of n records is multiplied before
  // it is used as a correction.
  static double shrinkage(std::size_t records) {
    return static_cast<double>(records) / static_cast<double>(records + 10);
  }
};

struct Cost {
  std::size_t multiply_adds = 0;  // number of multiply-adds per map
  std::size_t parameters = 0;
  Cost& operator+=(const Cost& other) {
    multiply_adds += other.multiply_adds, parameters += other.parameters;
    return *this;
  }
};

}  // namespace echofuse::recon
