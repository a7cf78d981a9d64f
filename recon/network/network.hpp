// SPDX-License-Identifier: MIT
// Fully connected network: layers (W, b) in one flat parameter array, rectifiers between them,
// linear output. Forward and backward passes process a batch.
#pragma once
#include <cstddef>
#include <vector>

#include "drivers/core/random.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

// y = x W + b. W (inputs x outputs, row-major) and b start at these offsets in the parameters.
struct Layer {
  std::size_t inputs, outputs, weights, biases;
};

struct Network {
  std::vector<Layer> layers;
  std::size_t parameters = 0;
  std::size_t weights = 0;  // multiply-adds of one forward pass
};

// `widths`: number of inputs, of units in each hidden layer, and of outputs.
Network make_network(const std::vector<std::size_t>& widths);

// Returns initial parameters (He et al., ICCV 2015): normal weights of variance 2 / inputs. Biases
// and the last layer's weights are zero, so that training starts from the mean map.
std::vector<float> initial_parameters(const Network& network, Rng& rng);

// Outputs of each layer for a batch, row-major [batch x outputs].
template <class T>
using Activations = std::vector<std::vector<T>>;

// Fully connected network. Instantiated for float (training) and double (checking the gradient).
template <class T>
void forward(const Network& network, const std::vector<T>& parameters, const T* inputs,
             std::size_t batch, Activations<T>& activations);

// Adds dL/d(parameters) to the gradient; an empty gradient counts as zeros. On entry
// activations.back() must contain dL/d(output). Overwrites the activations.
template <class T>
void backward(const Network& network, const std::vector<T>& parameters, const T* inputs,
              std::size_t batch, Activations<T>& activations, std::vector<T>& gradient);

// Reads or writes the weights and biases of each layer as "layer0", "layer1", ...
void archive(Archive archive, Network& network, std::vector<float>& parameters, std::size_t inputs,
             std::size_t outputs);

}  // namespace echofuse::recon
