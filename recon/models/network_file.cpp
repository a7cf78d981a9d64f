// SPDX-License-Identifier: MIT
#include "recon/models/network_file.hpp"

#include <span>

#include "recon/numbers/matrix_file.hpp"

namespace echofuse::recon {

void save_network(record::H5File& file, const std::string& group, const Network& network,
                  const std::vector<float>& parameters) {
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    const Layer& layer = network.layers[l];
    const std::string name = group + "/layer" + std::to_string(l);
    const std::span<const float> all(parameters);
    file.write(name + "/weights", all.subspan(layer.weights, layer.inputs * layer.outputs),
               {layer.inputs, layer.outputs});
    file.write(name + "/biases", all.subspan(layer.biases, layer.outputs), {layer.outputs});
  }
}

Network load_network(const record::H5File& file, const std::string& group, std::size_t inputs,
                     std::size_t outputs, std::vector<float>& parameters) {
  const auto name = [&](std::size_t l) { return group + "/layer" + std::to_string(l); };
  std::vector<std::size_t> widths{inputs};
  parameters.clear();
  for (std::size_t l = 0; l == 0 || file.has(name(l)); ++l) {
    const std::size_t width = file.has(name(l + 1)) ? record::H5File::any : outputs;
    const Matrix weights = read_matrix(file, name(l) + "/weights", widths.back(), width);
    require_sound(file, weights.cols > 0, name(l) + "/weights", "one output at least");
    const auto biases = file.read<float>(name(l) + "/biases", {weights.cols});
    widths.push_back(weights.cols);
    parameters.insert(parameters.end(), weights.values.begin(), weights.values.end());
    parameters.insert(parameters.end(), biases.begin(), biases.end());
  }
  return make_network(widths);
}

}  // namespace echofuse::recon
