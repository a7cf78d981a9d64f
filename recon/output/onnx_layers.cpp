// SPDX-License-Identifier: MIT
#include "recon/output/onnx_layers.hpp"

namespace echofuse::recon::onnx {

// OpenCV 4.6 needs these constants without a dimension for the batch.
std::string add_scaling(Graph& graph, const std::string& value, const std::vector<float>& centre,
                        const std::vector<float>& gain) {
  const Shape row{centre.size()};
  const std::string moved = graph.node("Sub", {value, graph.constant("centre", centre, row)});
  return graph.node("Mul", {moved, graph.constant("gain", gain, row)});
}

std::string add_layer(Graph& graph, const std::string& value, const AffineLayer& layer,
                      const std::string& name) {
  const Matrix& w = layer.weights;
  // Outputs x inputs, as PyTorch writes them: OpenCV 4.6 misreads the other order.
  std::vector<float> transposed(w.values.size());
  for (std::size_t i = 0; i < w.values.size(); ++i)
    transposed[i % w.cols * w.rows + i / w.cols] = w.values[i];
  const std::string out =
      graph.node("Gemm",
                 {value, graph.constant(name + "/weights", transposed, {w.cols, w.rows}),
                  graph.constant(name + "/biases", layer.biases, {w.cols})},
                 {attribute("transB", 1)});
  return layer.rectified ? graph.node("Relu", {out}) : out;
}

std::string add_layers(Graph& graph, std::string value, const Layers& layers,
                       const std::string& name) {
  for (std::size_t l = 0; l < layers.size(); ++l)
    value = add_layer(graph, value, layers[l], name + std::to_string(l));
  return value;
}

std::string add_reshape(Graph& graph, const std::string& value, const std::string& name,
                        const std::vector<std::int64_t>& shape, const std::string& output) {
  return graph.node("Reshape", {value, graph.constant(name, shape, {shape.size()})}, {}, output);
}

}  // namespace echofuse::recon::onnx
