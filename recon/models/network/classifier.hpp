// SPDX-License-Identifier: MIT
// A small network that tells two kinds of examples apart, fitted by logistic loss.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "recon/models/network/network.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

class Classifier {
 public:
  struct Options {
    std::vector<std::size_t> hidden;  // width of each hidden layer
    std::size_t steps, batch;         // half of a batch of each kind
    double learning_rate;             // at first; it falls to nothing
    std::uint64_t seed;
  };
  // One example a row. Ends early at an interrupt.
  void fit(const Matrix& usual, const Matrix& other, const Options& options);
  bool known() const { return !parameters_.empty(); }
  // Logarithm of the odds that it is of the other kind, if both are as frequent.
  double operator()(std::span<const float> inputs) const;

  void archive(Archive archive, std::size_t inputs);

 private:
  void learn_scale(const Matrix& usual, const Matrix& other);
  void standardise(std::span<const float> inputs, std::span<float> out) const;

  Network network_;
  std::vector<float> parameters_;
  std::vector<float> centre_, spread_;  // of the inputs
};

}  // namespace echofuse::recon
