// SPDX-License-Identifier: MIT
#pragma once
#include <string>
#include <vector>

#include "acquire/record/h5.hpp"
#include "recon/models/network/network.hpp"

namespace echofuse::recon {

// Weights and biases of each layer as group + "/layer0", "/layer1", ...
void save_network(record::H5File& file, const std::string& group, const Network& network,
                  const std::vector<float>& parameters);
// Its parameters go to `parameters`.
Network load_network(const record::H5File& file, const std::string& group, std::size_t inputs,
                     std::size_t outputs, std::vector<float>& parameters);

}  // namespace echofuse::recon
