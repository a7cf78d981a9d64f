// SPDX-License-Identifier: MIT
#include "recon/output/onnx.hpp"

#include "drivers/core/console.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

// A protobuf message as it is on the wire.
class Message {
 public:
  Message& number(std::uint32_t field, std::uint64_t value) {
    varint(field << 3);
    varint(value);
    return *this;
  }
  Message& bytes(std::uint32_t field, ByteView value) {
    varint(field << 3 | 2);
    varint(value.size());
    bytes_.insert(bytes_.end(), value.begin(), value.end());
    return *this;
  }
  Message& text(std::uint32_t field, const std::string& value) {
    return bytes(field, {reinterpret_cast<const std::uint8_t*>(value.data()), value.size()});
  }
  Message& message(std::uint32_t field, const Message& value) { return bytes(field, value.bytes_); }
  const Bytes& wire() const { return bytes_; }

 private:
  void varint(std::uint64_t v) {
    for (; v >= 128; v >>= 7) bytes_.push_back(static_cast<std::uint8_t>(v | 128));
    bytes_.push_back(static_cast<std::uint8_t>(v));
  }
  Bytes bytes_;
};

using Shape = std::vector<std::size_t>;
constexpr std::uint64_t type_float = 1, type_int64 = 7;

template <class T>
Message tensor(const std::string& name, const std::vector<T>& values, const Shape& shape) {
  Message out;
  for (const std::size_t n : shape) out.number(1, n);
  out.number(2, std::is_same_v<T, float> ? type_float : type_int64);
  return out.text(8, name).bytes(9, as_bytes(values));
}

// [n, shape...] of floats.
Message value_info(const std::string& name, const Shape& shape) {
  Message dimensions;
  dimensions.message(1, Message().text(2, "n"));
  for (const std::size_t n : shape) dimensions.message(1, Message().number(1, n));
  const Message type = Message().number(1, type_float).message(2, dimensions);
  return Message().text(1, name).message(2, Message().message(1, type));
}

// A chain of nodes, each working on what the one before it made, and its constants.
class Chain {
 public:
  explicit Chain(const std::string& input) : value_(input) {}
  template <class T>
  std::string constant(const std::string& name, const std::vector<T>& values, const Shape& shape) {
    graph_.message(5, tensor(name, values, shape));
    return name;
  }
  void add(const std::string& operation, const std::vector<std::string>& constants,
           Message node = {}, std::string output = {}) {
    if (output.empty()) output = "value" + std::to_string(count_);
    node.text(1, value_);
    for (const auto& name : constants) node.text(1, name);
    node.text(2, output).text(3, "node" + std::to_string(count_++)).text(4, operation);
    graph_.message(1, node);
    value_ = output;
  }
  Message& graph() { return graph_; }

 private:
  Message graph_;
  std::string value_;
  std::size_t count_ = 0;
};

void add_scaling(Chain& chain, const Features& f) {
  const Shape row{f.count()};
  std::vector<float> gain(f.count(), f.radar_gain);
  std::fill_n(gain.begin(), f.spd_count(), f.spd_gain);
  chain.add("Sub", {chain.constant("centre", f.centre, row)});
  chain.add("Mul", {chain.constant("gain", gain, row)});
}

void add_layer(Chain& chain, const AffineLayer& layer, const std::string& name) {
  const Matrix& w = layer.weights;
  // Outputs x inputs, as PyTorch writes them: OpenCV 4.6 misreads the other order. It also needs
  // the constants of Sub without a dimension for the batch.
  std::vector<float> transposed(w.values.size());
  for (std::size_t i = 0; i < w.values.size(); ++i)
    transposed[i % w.cols * w.rows + i / w.cols] = w.values[i];
  constexpr std::uint64_t type_int = 2;
  const Message attribute = Message().text(1, "transB").number(3, 1).number(20, type_int);
  chain.add("Gemm",
            {chain.constant(name + "/weights", transposed, {w.cols, w.rows}),
             chain.constant(name + "/biases", layer.biases, {w.cols})},
            Message().message(5, attribute));
  if (layer.rectified) chain.add("Relu", {});
}

void add_metadata(Message& model, const Features& f) {
  const auto entry = [&](const std::string& key, const std::string& value) {
    model.message(14, Message().text(1, key).text(2, value));
  };
  entry("inputs", name_of(f.inputs));
  entry("scaling", f.scaling);
  for (const Axis* axis : {&f.spd_axis, &f.radar_axis}) {
    if (axis == (f.inputs == Inputs::radar ? &f.spd_axis : nullptr)) continue;
    if (axis == (f.inputs == Inputs::spd ? &f.radar_axis : nullptr)) continue;
    entry(axis->name + "_axis",
          formatted("%s %s count %u start %.17g step %.17g", axis->quantity.c_str(),
                    axis->unit.c_str(), axis->count, axis->start, axis->step));
  }
}

}  // namespace

Bytes to_onnx(const TrainedModel& model, const std::string& path) {
  const std::vector<AffineLayer> layers = model.model->layers();
  if (layers.empty())
    throw Error(ExitCode::failed,
                path + ": a model of kind \"" + model.name +
                    "\" is not a plain network; mlp, ridge and pca-mlp can be exported");
  Chain chain("record");
  add_scaling(chain, model.features);
  for (std::size_t l = 0; l < layers.size(); ++l)
    add_layer(chain, layers[l], "layer" + std::to_string(l));
  const std::uint32_t size = model.scene.grid.size;
  chain.add("Reshape",
            {chain.constant("map_shape", std::vector<std::int64_t>{-1, size, size}, {3})}, {},
            "depth_m");
  chain.graph().text(2, "echofuse");
  chain.graph().message(11, value_info("record", {model.features.count()}));
  chain.graph().message(12, value_info("depth_m", {size, size}));
  Message out;
  out.number(1, 6).text(2, "echofuse").text(3, version()).message(7, chain.graph());
  out.message(8, Message().number(2, 11));
  add_metadata(out, model.features);
  return out.wire();
}

}  // namespace echofuse::recon
