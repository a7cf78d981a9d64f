// SPDX-License-Identifier: MIT
// Adam (Kingma and Ba, arXiv 1412.6980) with decoupled weight decay (Loshchilov and Hutter, arXiv
// 1711.05101).
#pragma once
#include <cstddef>
#include <vector>

namespace echofuse::recon {

class Adam {
 public:
  Adam(std::size_t parameters, double weight_decay)
      : decay_(static_cast<float>(weight_decay)), first_(parameters), second_(parameters) {}
  void step(std::vector<float>& parameters, const std::vector<float>& gradient,
            double learning_rate);

 private:
  float decay_;
  std::size_t steps_ = 0;
  std::vector<float> first_, second_;  // running moments of the gradient
};

}  // namespace echofuse::recon
