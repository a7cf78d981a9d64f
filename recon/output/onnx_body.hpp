// SPDX-License-Identifier: MIT
// Nodes of a model that places a body and draws it into the map. All are plain operators:
// interpolating is a product with weights max(0, 1 - |distance in cells|); a comparison is a slope
// so steep that hardly any number lies on it.
#pragma once
#include <string>

#include "recon/models/layers.hpp"
#include "recon/output/onnx_graph.hpp"

namespace echofuse::recon::onnx {

// `inputs`: [n, inputs of the model]. The name of the map: [n, pixels of the map], metres.
std::string add_body(Graph& graph, const BodyLayers& body, const std::string& inputs);

}  // namespace echofuse::recon::onnx
