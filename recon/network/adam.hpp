// SPDX-License-Identifier: MIT
// Optimiser Adam (Kingma and Ba, arXiv 1412.6980) with decoupled weight decay (Loshchilov and
// Hutter, arXiv 1711.05101).
#pragma once
#include <cstddef>
#include <vector>

namespace echofuse::recon {

struct Adam {
  Adam(std::size_t parameters, double weight_decay)
      : decay(static_cast<float>(weight_decay)), first(parameters), second(parameters) {}
  // Updates the parameters by one step, and sets the gradient to zero for the next backward().
  void step(std::vector<float>& parameters, std::vector<float>& gradient, double learning_rate);

  float decay;
  std::size_t steps = 0;
  std::vector<float> first, second;  // running means of the gradient and of its square
};

}  // namespace echofuse::recon
