// SPDX-License-Identifier: MIT
#include "recon/output/onnx_graph.hpp"

namespace echofuse::recon::onnx {
namespace {

// [n, shape...] of floats.
Message value_info(const std::string& name, const Shape& shape) {
  Message dimensions;
  dimensions.message(1, Message().text(2, "n"));
  for (const std::size_t n : shape) dimensions.message(1, Message().number(1, n));
  const Message type = Message().number(1, type_float).message(2, dimensions);
  return Message().text(1, name).message(2, Message().message(1, type));
}

}  // namespace

Message& Message::number(std::uint32_t field, std::uint64_t value) {
  varint(field << 3);
  varint(value);
  return *this;
}

Message& Message::bytes(std::uint32_t field, ByteView value) {
  varint(field << 3 | 2);
  varint(value.size());
  bytes_.insert(bytes_.end(), value.begin(), value.end());
  return *this;
}

Message& Message::text(std::uint32_t field, const std::string& value) {
  return bytes(field, {reinterpret_cast<const std::uint8_t*>(value.data()), value.size()});
}

void Message::varint(std::uint64_t v) {
  for (; v >= 128; v >>= 7) bytes_.push_back(static_cast<std::uint8_t>(v | 128));
  bytes_.push_back(static_cast<std::uint8_t>(v));
}

Message attribute(const std::string& name, std::uint64_t value) {
  constexpr std::uint64_t type_int = 2;
  return Message().text(1, name).number(3, value).number(20, type_int);
}

std::string Graph::constant(const std::string& name, std::uint64_t type, ByteView values,
                            const Shape& shape) {
  Message tensor;
  for (const std::size_t n : shape) tensor.number(1, n);
  graph_.message(5, tensor.number(2, type).text(8, name).bytes(9, values));
  return name;
}

std::string Graph::node(const std::string& operation, const std::vector<std::string>& inputs,
                        const std::vector<Message>& attributes, std::string output) {
  Message node;
  for (const auto& input : inputs) node.text(1, input);
  if (output.empty()) output = "value" + std::to_string(nodes_);
  node.text(2, output).text(3, "node" + std::to_string(nodes_++)).text(4, operation);
  for (const auto& attribute : attributes) node.message(5, attribute);
  graph_.message(1, node);
  return output;
}

void Graph::input(const std::string& name, const Shape& shape) {
  graph_.message(11, value_info(name, shape));
}

void Graph::output(const std::string& name, const Shape& shape) {
  graph_.message(12, value_info(name, shape));
}

}  // namespace echofuse::recon::onnx
