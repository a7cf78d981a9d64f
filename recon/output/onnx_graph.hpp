// SPDX-License-Identifier: MIT
// An ONNX graph as it is written: values by name, each made by one node.
// Source: onnx.proto of ONNX 1.12 (field numbers), protobuf.dev/programming-guides/encoding.
#pragma once
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::recon::onnx {

// A protobuf message as it is on the wire.
class Message {
 public:
  Message& number(std::uint32_t field, std::uint64_t value);
  Message& bytes(std::uint32_t field, ByteView value);
  Message& text(std::uint32_t field, const std::string& value);
  Message& message(std::uint32_t field, const Message& value) { return bytes(field, value.bytes_); }
  const Bytes& wire() const { return bytes_; }

 private:
  void varint(std::uint64_t v);
  Bytes bytes_;
};

using Shape = std::vector<std::size_t>;
inline constexpr std::uint64_t type_float = 1, type_int64 = 7;

// Of a node: a whole number.
Message attribute(const std::string& name, std::uint64_t value);

class Graph {
 public:
  // A constant's name: `name`, as it is given.
  template <class T>
  std::string constant(const std::string& name, const std::vector<T>& values, const Shape& shape) {
    constexpr bool real = std::is_same_v<T, float>;
    return constant(name, real ? type_float : type_int64, as_bytes(values), shape);
  }
  // The name of the value that the node makes: `output`, or a number if that is empty.
  std::string node(const std::string& operation, const std::vector<std::string>& inputs,
                   const std::vector<Message>& attributes = {}, std::string output = {});
  // [n, shape...] of floats.
  void input(const std::string& name, const Shape& shape);
  void output(const std::string& name, const Shape& shape);
  Message finish(const std::string& name) { return graph_.text(2, name); }

 private:
  std::string constant(const std::string& name, std::uint64_t type, ByteView values,
                       const Shape& shape);
  Message graph_;
  std::size_t nodes_ = 0;
};

}  // namespace echofuse::recon::onnx
