// SPDX-License-Identifier: MIT
// The few things of HDF5 that exports need: n-d arrays, texts, attributes, scales of dimensions.
//   H5Out out("a.h5");
//   out.write<float>("weights/0", values, {rows, columns});   // groups come by themselves
//   out.set("weights/0", "units", "1");
// Element types: float, double, uint8, uint32, int64, uint64. Texts are UTF-8, written with a fixed
// length, as not every reader takes others.
#pragma once
#include <cstdint>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace echofuse::record {

using H5Shape = std::vector<std::size_t>;
using H5Value = std::variant<std::string, double, std::int64_t, std::vector<std::string>>;

// Threading: HDF5 is not thread-safe; all files of a process belong to one thread at a time. Every
// member throws Error naming the file and the dataset (disk if a write failed, failed otherwise).
class H5Out {
 public:
  explicit H5Out(std::string path);  // refuses a path that exists
  ~H5Out();                          // closes; call close() to see errors
  H5Out(const H5Out&) = delete;
  H5Out& operator=(const H5Out&) = delete;
  void close();

  // Row-major. Arrays of two or more dimensions are compressed, one chunk for each index of the
  // first dimension.
  template <class T>
  void write(const std::string& name, const std::vector<T>& values, const H5Shape& shape);
  // For what does not fit into memory: makes an array of zeros, then fills its rows.
  template <class T>
  void allocate(const std::string& name, const H5Shape& shape);
  template <class T>
  void write_row(const std::string& name, std::size_t row, std::span<const T> values);
  void write_text(const std::string& name, const std::string& text);
  void write_texts(const std::string& name, const std::vector<std::string>& texts);
  void make_group(const std::string& name);
  // Another name of a dataset. What stands along one of its dimensions is its scale there.
  void link(const std::string& name, const std::string& dataset);
  void put_scale(const std::string& name, unsigned dimension, const std::string& scale);
  // An attribute of a dataset or group; "/" is the file itself.
  void set(const std::string& object, const std::string& attribute, const H5Value& value);
  bool has(const std::string& name) const;

 private:
  void write_strings(const std::string& name, const std::vector<std::string>& texts,
                     const H5Shape& shape);
  [[noreturn]] void fail(const std::string& name, const char* what) const;
  [[noreturn]] void refuse(const std::string& name, const char* why) const;
  std::int64_t dataset(const std::string& name) const;
  std::int64_t make_dataset(const std::string& name, std::int64_t type, const H5Shape& shape);

  std::string path_;
  std::int64_t file_;  // hid_t, negative when closed
};

}  // namespace echofuse::record
