// SPDX-License-Identifier: MIT
// A TensorFile holds tensors and facts in one safetensors file
// (github.com/huggingface/safetensors). Python opens it with the package of that name or with
// twenty lines of NumPy.
//
//   off 0  u64 N: length of the header, at most 1 MiB
//   off 8  u8[N]: JSON, {"__metadata__": {"crc32c": "89abcdef", "facts": "TEXT", "kernel",
//   "commit"},
//                        NAME: {"dtype": "F32", "shape": [64, 48], "data_offsets": [0, 12288]},
//                        ...}
//   then   the tensors: row-major, little-endian, one behind the other without a gap; those of
//          8 bytes a value first, then of 4, then of 1, so that each is aligned
//
// TEXT is a JSON object of numbers and texts by name, as the format takes only texts there. crc32c
// is the CRC-32C of the whole file, in which these eight digits are zeros. kernel (of the matrix
// product) and commit are of the program that wrote the file; nothing reads them.
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
  // Length of a dimension that is not checked.
  static constexpr std::size_t any = std::numeric_limits<std::size_t>::max();
  using Fact = std::variant<std::int64_t, double, std::string>;

  TensorFile() = default;  // an empty one, to be filled
  // Checks all of the file before anything of it is used. `path` is the name that messages show.
  // Throws Error(failed) that names what is wrong and what would be right.
  TensorFile(std::string path, ByteView contents);
  Bytes to_bytes() const;

  // T is float, double, std::int64_t, std::uint32_t or std::uint8_t.
  template <class T>
  void write(const std::string& name, std::span<const T> values, const TensorShape& shape);
  // Throws Error(failed) unless the tensor is there, is of type T and of this shape, and holds
  // finite numbers of at most 1e18 in size.
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

// Visits the parts of an object, either to write them or to read and check them, so that one
// function of each class serves both ways:
//
//   void Ridge::archive(Archive& a) {
//     a.table("weights", weights_, inputs, outputs);
//     a.number("penalty", penalty_, 0, 1e18);
//   }
//
// Every member throws Error(failed) if what is read is not as it should be.
class Archive {
 public:
  enum class Direction : bool { write, read };
  static constexpr std::size_t any = TensorFile::any;

  Archive(TensorFile& file, Direction direction, std::string group = {})
      : file_(&file), direction_(direction), group_(std::move(group)) {}
  bool reading() const { return direction_ == Direction::read; }
  // The names in the returned archive begin with the group's: "group/name".
  Archive in(const std::string& group) const { return {*file_, direction_, group_ + group + "/"}; }

  template <class T>
  void values(const std::string& name, std::vector<T>& values, std::size_t count);
  void table(const std::string& name, Matrix& table, std::size_t rows, std::size_t cols);
  void number(const std::string& name, double& value, double least, double most);
  void number(const std::string& name, float& value, double least, double most);
  template <class Integer>
  void count(const std::string& name, Integer& value, std::int64_t least, std::int64_t most) {
    auto whole = static_cast<std::int64_t>(value);
    whole_number(name, whole, least, most);
    value = static_cast<Integer>(whole);
  }
  // The text is one of `allowed`, or any text if that list is empty.
  void text(const std::string& name, std::string& value, const std::vector<std::string>& allowed);
  // Writes, or reads and returns, whether an optional part is there.
  bool part(const std::string& name, bool there);
  // When it reads, it refuses the file unless the file has a tensor of this shape.
  void require_shape(const std::string& name, const TensorShape& shape) const;
  // When it reads, it refuses the file unless `sound` holds.
  void require(bool sound, const std::string& name, const std::string& expected) const;

 private:
  void whole_number(const std::string& name, std::int64_t& value, std::int64_t least,
                    std::int64_t most);
  template <class T>
  T fact(const std::string& name, const char* expected) const;

  TensorFile* file_;
  Direction direction_;
  std::string group_;
};

}  // namespace echofuse::recon
