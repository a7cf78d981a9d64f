// SPDX-License-Identifier: MIT
// Nodes of plain networks. Each function gives the name of the value that it makes.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "recon/models/layers.hpp"
#include "recon/output/onnx_graph.hpp"

namespace echofuse::recon::onnx {

using Layers = std::vector<AffineLayer>;

// (value - centre) * gain, column by column.
std::string add_scaling(Graph& graph, const std::string& value, const std::vector<float>& centre,
                        const std::vector<float>& gain);
std::string add_layer(Graph& graph, const std::string& value, const AffineLayer& layer,
                      const std::string& name);
std::string add_layers(Graph& graph, std::string value, const Layers& layers,
                       const std::string& name);
// -1: as many as there are.
std::string add_reshape(Graph& graph, const std::string& value, const std::string& name,
                        const std::vector<std::int64_t>& shape, const std::string& output = {});

}  // namespace echofuse::recon::onnx
