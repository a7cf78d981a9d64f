// SPDX-License-Identifier: MIT
// Tensors and facts in one safetensors file (github.com/huggingface/safetensors). Python reads it
// with the package safetensors or with twenty lines of NumPy.
//
//   off 0  u64 N: length of the header, at most 1 MiB
//   off 8  u8[N]: JSON,
//          {"__metadata__": {"crc32c": "89abcdef", "facts": "TEXT", "kernel": ..., "commit": ...},
//           NAME: {"dtype": "F32", "shape": [64, 48], "data_offsets": [0, 12288]},
//           ...}
//   then   the tensors: row-major, little-endian, contiguous. Tensors with 8 bytes per
//          value come first, then those with 4, then those with 1, so that all are aligned.
//
// The format allows only strings in __metadata__, so TEXT is a JSON object (numbers and strings by
// name) as a string. crc32c is the CRC-32C of the whole file with zeros in place of these eight
// digits. kernel (of the matrix product) and commit describe the program that wrote the file; they
// are not read.
#pragma once
#include <cstdint>
#include <limits>
#include <map>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

using TensorShape = std::vector<std::size_t>;

class TensorFile {
 public:
  // Placeholder that matches a dimension of any length.
  static constexpr std::size_t any = std::numeric_limits<std::size_t>::max();
  using Fact = std::variant<std::int64_t, double, std::string>;

  TensorFile() = default;  // creates an empty file, for writing
  // Checks and parses the whole file. `path` appears in messages. If the file is invalid, throws
  // Error(failed) with the fault and the expected value.
  TensorFile(std::string path, ByteView contents);
  Bytes to_bytes() const;

  // Adds a tensor. T is float, double, std::int64_t, std::uint32_t or std::uint8_t.
  template <class T>
  void write(const std::string& name, std::span<const T> values, const TensorShape& shape);
  // Returns the values of a tensor. Throws Error(failed) unless the tensor exists, has type T and
  // this shape, and contains only finite numbers up to 1e18.
  template <class T>
  std::vector<T> read(const std::string& name, const TensorShape& shape) const;
  bool has(const std::string& name) const { return tensors_.count(name) > 0; }
  TensorShape shape(const std::string& name) const;

  std::map<std::string, Fact> facts;
  [[noreturn]] void refuse(const std::string& object, const std::string& why) const;

 private:
  struct Tensor {
    std::string type;
    TensorShape shape;
    Bytes values;
  };
  const Tensor& found(const std::string& name) const;
  void parse(const std::string& header, ByteView values);

  std::string path_ = "model";
  std::map<std::string, Tensor> tensors_;
};

// Either writes the members of an object, or reads and checks them. Each class needs only one
// function for both directions:
//
//   void Ridge::archive(Archive& a) {
//     a.table("weights", weights_, inputs, outputs);
//     a.number("penalty", penalty_, 0, 1e18);
//   }
//
// When reading, every function throws Error(failed) if a value is invalid.
class Archive {
 public:
  enum class Direction : bool { write, read };
  static constexpr std::size_t any = TensorFile::any;

  Archive(TensorFile& file, Direction direction, std::string group = {})
      : file_(&file), direction_(direction), group_(std::move(group)) {}
  bool reading() const { return direction_ == Direction::read; }
  // Returns an archive that adds the prefix "GROUP/" to all names.
  Archive in(const std::string& group) const { return {*file_, direction_, group_ + group + "/"}; }

  template <class T>
  void values(const std::string& name, std::vector<T>& values, std::size_t count);
  void table(const std::string& name, Matrix& table, std::size_t rows, std::size_t cols);
  void number(const std::string& name, double& value, double minimum, double maximum);
  void number(const std::string& name, float& value, double minimum, double maximum);
  template <class Integer>
  void count(const std::string& name, Integer& value, std::int64_t minimum, std::int64_t maximum) {
    auto whole = static_cast<std::int64_t>(value);
    integer(name, whole, minimum, maximum);
    value = static_cast<Integer>(whole);
  }
  // Reads or writes a string, which must be one of `allowed`; an empty list allows any string.
  void text(const std::string& name, std::string& value, const std::vector<std::string>& allowed);
  // Reads or writes whether an optional part exists, and returns true if it does.
  bool part(const std::string& name, bool there);
  // When reading, throws Error(failed) unless the file has a tensor of this shape.
  void require_shape(const std::string& name, const TensorShape& shape) const;
  // When reading, throws Error(failed) unless `sound` is true.
  void require(bool sound, const std::string& name, const std::string& expected) const;

 private:
  void integer(const std::string& name, std::int64_t& value, std::int64_t minimum,
               std::int64_t maximum);
  template <class T>
  T fact(const std::string& name, const char* expected) const;

  TensorFile* file_;
  Direction direction_;
  std::string group_;
};

}  // namespace echofuse::recon
