// SPDX-License-Identifier: MIT
// The few things of HDF5 that exports need, and their tests: n-d arrays, texts, attributes.
//   H5File out = H5File::create("a.h5");
//   out.write<float>("weights/0", values, {rows, columns});   // groups come by themselves
//   out.set("weights/0", "units", "1");
// Element types: float, double, (u)int8, uint16, uint32, int32, int64, uint64. Texts are UTF-8,
// written with a fixed length, as not every reader takes others.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::record {

using H5Shape = std::vector<std::size_t>;
using H5Value = std::variant<std::string, double, std::int64_t, std::vector<std::string>>;

// Threading: HDF5 is not thread-safe; all files of a process belong to one thread at a time. Every
// member throws Error naming the file and the dataset (disk if a write failed, failed otherwise).
class H5File {
 public:
  static H5File create(const std::string& path);  // refuses a path that exists
  static H5File open(const std::string& path);    // read-only
  ~H5File();  // closes; call close() after writing to see errors
  H5File(H5File&& other) noexcept;
  H5File& operator=(H5File&&) = delete;
  void close();

  // Row-major; shape {} is a scalar. Arrays of two or more dimensions are compressed, one chunk
  // for each index of the first dimension.
  template <class T>
  void write(const std::string& name, std::span<const T> values, const H5Shape& shape);
  template <class T>
  void write(const std::string& name, const std::vector<T>& values, const H5Shape& shape) {
    write<T>(name, std::span<const T>(values), shape);
  }
  // For what does not fit into memory: makes an array of zeros, then fills whole rows from `first`.
  template <class T>
  void allocate(const std::string& name, const H5Shape& shape);
  template <class T>
  void write_rows(const std::string& name, std::size_t first, std::span<const T> values);
  void write_text(const std::string& name, const std::string& text);
  void write_texts(const std::string& name, const std::vector<std::string>& texts);
  void make_group(const std::string& name);
  // Another name of a dataset. What stands along one of its dimensions is its scale there.
  void link(const std::string& name, const std::string& dataset);
  void put_scale(const std::string& name, unsigned dimension, const std::string& scale);
  // An attribute of a dataset or group; "." is the file itself.
  void set(const std::string& object, const std::string& attribute, const H5Value& value);

  bool has(const std::string& name) const;
  H5Shape shape(const std::string& name) const;
  // All values in row-major order, converted to T as HDF5 does between numbers.
  template <class T>
  std::vector<T> read(const std::string& name) const;
  std::string read_text(const std::string& name) const;
  std::vector<std::string> read_texts(const std::string& name) const;
  bool has_attribute(const std::string& object, const std::string& attribute) const;
  template <class T>  // std::string, double or std::int64_t
  T get(const std::string& object, const std::string& attribute) const;
  // Throws Error(failed) that says what of an object is wrong, and what would be right.
  [[noreturn]] void refuse(const std::string& object, const std::string& why) const;

 private:
  H5File(std::string path, std::int64_t file) : path_(std::move(path)), file_(file) {}
  std::int64_t open_attribute(const std::string& object, const std::string& attribute,
                              int wanted) const;
  std::string checked(const std::string& name, std::string text) const;
  std::int64_t text_type(std::size_t length, bool ascii = false) const;
  void write_strings(const std::string& name, const std::vector<std::string>& texts,
                     const H5Shape& shape);
  [[noreturn]] void fail(const std::string& name, const char* what, bool writing) const;
  std::int64_t dataset(const std::string& name) const;
  std::int64_t make_dataset(const std::string& name, std::int64_t type, const H5Shape& shape);

  std::string path_;
  std::int64_t file_;  // hid_t, negative when closed
};

template <>
std::string H5File::get(const std::string& object, const std::string& attribute) const;
template <>
double H5File::get(const std::string& object, const std::string& attribute) const;
template <>
std::int64_t H5File::get(const std::string& object, const std::string& attribute) const;

}  // namespace echofuse::record
