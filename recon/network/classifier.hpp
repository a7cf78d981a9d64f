// SPDX-License-Identifier: MIT
// Small network that separates two classes of examples, fitted by logistic loss.
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
    std::size_t steps, batch;         // half of each batch from each class
    double learning_rate;             // initial rate; decreases to zero
    std::uint64_t seed;
  };
  // One example per row. An interrupt ends the fit early.
  void fit(const Matrix& usual, const Matrix& other, const Options& options);
  bool known() const { return !parameters_.empty(); }
  // Returns the log odds of the class `other`, for equally frequent classes.
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
