// SPDX-License-Identifier: MIT
#include "recon/network/network.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "drivers/core/clones.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/row_product.hpp"

namespace echofuse::recon {
namespace {

template <class T>
[[gnu::always_inline]] inline void add_each(const T* row, std::size_t count, T* __restrict__ sums) {
  for (std::size_t i = 0; i < count; ++i) sums[i] += row[i];
}
ECHOFUSE_CLONES void add_row(const float* row, std::size_t count, float* sums) {
  add_each(row, count, sums);
}
void add_row(const double* row, std::size_t count, double* sums) { add_each(row, count, sums); }

// Sets the derivatives of the loss to 0 where the output of the rectifier is 0, because the
// derivative of the rectifier is 0 there. Writes all derivatives, because branches on unpredictable
// signs would be slower.
template <class T>
[[gnu::always_inline]] inline void pass_slopes_each(const T* x, std::size_t count,
                                                    T* __restrict__ slopes) {
  for (std::size_t i = 0; i < count; ++i) slopes[i] = x[i] <= 0 ? T{0} : slopes[i];
}
ECHOFUSE_CLONES void pass_slopes(const float* x, std::size_t count, float* slopes) {
  pass_slopes_each(x, count, slopes);
}
void pass_slopes(const double* x, std::size_t count, double* slopes) {
  pass_slopes_each(x, count, slopes);
}

void add_products(std::size_t batch, const Layer& layer, const float* x, const float* weights,
                  float* y) {
  add_row_products(batch, layer.outputs, layer.inputs, x, weights, y);
}
void add_products(std::size_t batch, const Layer& layer, const double* x, const double* weights,
                  double* y) {
  multiply(Product<double>{batch, layer.outputs, layer.inputs, Transpose::no, Transpose::no, 1, 1},
           x, weights, y);
}

}  // namespace

Network make_network(const std::vector<std::size_t>& widths) {
  Network out;
  for (std::size_t i = 1; i < widths.size(); ++i) {
    const std::size_t in = widths[i - 1], n = widths[i];
    out.layers.push_back({in, n, out.parameters, out.parameters + in * n});
    out.parameters += in * n + n;
    out.weights += in * n;
  }
  return out;
}

std::vector<float> initial_parameters(const Network& network, Rng& rng) {
  std::vector<float> out(network.parameters);
  for (std::size_t l = 0; l + 1 < network.layers.size(); ++l) {
    const Layer& layer = network.layers[l];
    std::normal_distribution<float> normal(0, std::sqrt(2.f / static_cast<float>(layer.inputs)));
    const auto first = out.begin() + static_cast<std::ptrdiff_t>(layer.weights);
    std::generate_n(first, layer.inputs * layer.outputs, [&] { return normal(rng); });
  }
  return out;
}

template <class T>
void forward(const Network& network, const std::vector<T>& parameters, const T* inputs,
             std::size_t batch, Activations<T>& activations) {
  activations.resize(network.layers.size());
  const T* x = inputs;
  for (std::size_t l = 0; l < network.layers.size(); ++l) {
    const Layer& layer = network.layers[l];
    auto& y = activations[l];
    y.resize(batch * layer.outputs);
    for (std::size_t i = 0; i < batch; ++i)
      std::copy_n(parameters.data() + layer.biases, layer.outputs, y.data() + i * layer.outputs);
    add_products(batch, layer, x, parameters.data() + layer.weights, y.data());
    if (l + 1 < network.layers.size())
      for (T& v : y) v = std::max(v, T{0});
    x = y.data();
  }
}

template <class T>
void backward(const Network& network, const std::vector<T>& parameters, const T* inputs,
              std::size_t batch, Activations<T>& activations, std::vector<T>& gradient) {
  gradient.resize(network.parameters);
  for (std::size_t l = network.layers.size(); l-- > 0;) {
    const Layer& layer = network.layers[l];
    // Derivative of the loss with respect to the output of layer l.
    const auto& slope = activations[l];
    const T* x = l > 0 ? activations[l - 1].data() : inputs;
    multiply({layer.inputs, layer.outputs, batch, Transpose::yes, Transpose::no, T{1}, T{1}}, x,
             slope.data(), gradient.data() + layer.weights);
    for (std::size_t i = 0; i < batch; ++i)
      add_row(slope.data() + i * layer.outputs, layer.outputs, gradient.data() + layer.biases);
    if (l == 0) return;
    typename Activations<T>::value_type below(batch * layer.inputs);
    multiply({batch, layer.inputs, layer.outputs, Transpose::no, Transpose::yes, T{1}, T{0}},
             slope.data(), parameters.data() + layer.weights, below.data());
    pass_slopes(x, below.size(), below.data());
    activations[l - 1] = std::move(below);
  }
}

template void forward(const Network&, const std::vector<float>&, const float*, std::size_t,
                      Activations<float>&);
template void forward(const Network&, const std::vector<double>&, const double*, std::size_t,
                      Activations<double>&);
template void backward(const Network&, const std::vector<float>&, const float*, std::size_t,
                       Activations<float>&, std::vector<float>&);
template void backward(const Network&, const std::vector<double>&, const double*, std::size_t,
                       Activations<double>&, std::vector<double>&);

namespace {

// Reads or writes the weights and biases of a layer, at its offsets in `parameters`.
void archive_layer(Archive archive, const Layer& layer, std::vector<float>& parameters) {
  Matrix weights(layer.inputs, layer.outputs);
  std::vector<float> biases(layer.outputs);
  const auto weights_at = parameters.begin() + static_cast<std::ptrdiff_t>(layer.weights),
             biases_at = parameters.begin() + static_cast<std::ptrdiff_t>(layer.biases);
  std::copy_n(weights_at, weights.values.size(), weights.values.begin());
  std::copy_n(biases_at, biases.size(), biases.begin());
  archive.table("weights", weights, layer.inputs, layer.outputs);
  archive.values("biases", biases, layer.outputs);
  std::copy(weights.values.begin(), weights.values.end(), weights_at);
  std::copy(biases.begin(), biases.end(), biases_at);
}

}  // namespace

void archive(Archive archive, Network& network, std::vector<float>& parameters, std::size_t inputs,
             std::size_t outputs) {
  std::vector<std::int64_t> widths;
  if (!archive.reading()) {
    widths.push_back(static_cast<std::int64_t>(network.layers.front().inputs));
    for (const Layer& layer : network.layers)
      widths.push_back(static_cast<std::int64_t>(layer.outputs));
  }
  archive.values("widths", widths, Archive::any);
  if (archive.reading()) {
    archive.require(widths.size() >= 2 && widths.size() <= 16 &&
                        std::all_of(widths.begin(), widths.end(),
                                    [](auto w) { return w > 0 && w <= 1 << 20; }) &&
                        std::cmp_equal(widths.front(), inputs) &&
                        std::cmp_equal(widths.back(), outputs),
                    "widths",
                    "expected first and last width " + std::to_string(inputs) + " and " +
                        std::to_string(outputs));
    // Checks the shapes of the tensors before memory is allocated for the widths in the file.
    for (std::size_t l = 0; l + 1 < widths.size(); ++l)
      archive.in("layer" + std::to_string(l))
          .require_shape("weights", {static_cast<std::size_t>(widths[l]),
                                     static_cast<std::size_t>(widths[l + 1])});
    network = make_network({widths.begin(), widths.end()});
    parameters.assign(network.parameters, 0.f);
  }
  for (std::size_t l = 0; l < network.layers.size(); ++l)
    archive_layer(archive.in("layer" + std::to_string(l)), network.layers[l], parameters);
}

}  // namespace echofuse::recon
