// SPDX-License-Identifier: MIT
// A small network tells two kinds of examples apart; it is fitted by logistic loss.
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
    std::size_t steps, batch;         // half of each batch is of each kind
    double learning_rate;             // the first rate; it falls to zero
    std::uint64_t seed;
  };
  // There is one example a row. The fit ends early at an interrupt.
  void fit(const Matrix& usual, const Matrix& other, const Options& options);
  bool known() const { return !parameters_.empty(); }
  // Returns the logarithm of the odds that the example is of the other kind, if both kinds are
  // equally frequent.
  double operator()(std::span<const float> inputs) const;

  void archive(Archive archive, std::size_t inputs);

 private:
  void learn_scale(const Matrix& usual, const Matrix& other);
  void standardise(std::span<const float> inputs, std::span<float> out) const;

  Network network_;
  std::vector<float> parameters_;
  std::vector<float> centre_, spread_;  // centre and spread of the inputs
};

}  // namespace echofuse::recon
