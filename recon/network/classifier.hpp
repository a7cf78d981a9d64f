// SPDX-License-Identifier: MIT
// Small network that separates two classes of examples. It is trained with a logistic loss.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "recon/network/network.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

class Classifier {
 public:
  struct Options {
    std::vector<std::size_t> hidden;  // width of each hidden layer
    // Number of training steps, and batch size; each batch contains equal numbers of examples of
    // the two classes.
    std::size_t steps, batch;
    double learning_rate;  // initial learning rate, which decreases to zero
    std::uint64_t seed;
  };
  // Fits the network to examples of two classes, one example per row. An interrupt ends the fit
  // early.
  void fit(const Matrix& usual, const Matrix& other, const Options& options);
  bool known() const { return !parameters_.empty(); }
  // Returns the log odds of the class `other`, assuming that both classes are equally frequent.
  double operator()(std::span<const float> inputs) const;

  void archive(Archive archive, std::size_t inputs);

 private:
  void learn_scale(const Matrix& usual, const Matrix& other);
  void standardise(std::span<const float> inputs, std::span<float> out) const;

  Network network_;
  std::vector<float> parameters_;
  std::vector<float> centre_, spread_;  // mean and scale of each input
};

}  // namespace echofuse::recon
