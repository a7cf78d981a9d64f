// SPDX-License-Identifier: MIT
// Fully connected network: layers (W, b) in one flat parameter array, rectifiers between them,
// linear output. Forward and backward passes process a batch.
#pragma once
#include <cstddef>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

// Layer of a network: y = x W + b. W (inputs x outputs, row-major) begins at offset `weights` in
// the parameters, and b begins at offset `biases`.
struct Layer {
  std::size_t inputs, outputs, weights, biases;
};

struct Network {
  std::vector<Layer> layers;
  std::size_t parameters = 0;
  // Number of weights, equal to the number of multiply-adds in a forward pass.
  std::size_t weights = 0;
};

// Returns a network. `widths`: number of inputs, number of units in each hidden layer, and number
// of outputs.
Network make_network(const std::vector<std::size_t>& widths);

// Returns random initial parameters: normally distributed weights with variance 2 / inputs (He et
// al., ICCV 2015). Biases and the weights of the last layer are zero. All outputs are therefore
// initially 0, which corresponds to the mean of the targets (regression.hpp).
std::vector<float> initial_parameters(const Network& network, Rng& rng);

// Outputs of each layer for a batch: row-major tables [batch x outputs].
template <class T>
using Activations = std::vector<std::vector<T>>;

// Forward pass: computes the outputs of all layers for a batch of inputs [batch x inputs].
// Instantiated for float (training) and double (gradient test).
template <class T>
void forward(const Network& network, const std::vector<T>& parameters, const T* inputs,
             std::size_t batch, Activations<T>& activations);

// Backward pass: adds dL/d(parameters) to the gradient, where L is the loss. An empty gradient is
// first filled with zeros. On entry, activations.back() must contain dL/d(output). Overwrites the
// activations.
template <class T>
void backward(const Network& network, const std::vector<T>& parameters, const T* inputs,
              std::size_t batch, Activations<T>& activations, std::vector<T>& gradient);

// Reads or writes the weights and biases as groups "layer0", "layer1", ... Throws Error(failed) if
// the number of inputs or outputs in the file is wrong.
void archive(Archive archive, Network& network, std::vector<float>& parameters, std::size_t inputs,
             std::size_t outputs);

}  // namespace echofuse::recon
