// SPDX-License-Identifier: MIT
// The few things of HDF5 that exports and model files need: n-d arrays, texts, attributes.
//   H5File out = H5File::create("a.h5");
//   out.write<float>("weights/0", values, {rows, columns});   // groups come by themselves
//   out.set("weights/0", "units", "1");
// Element types: float, double, (u)int8, uint16, uint32, int32, int64, uint64. Texts are UTF-8.
//
// A sealed file is one that may come from anybody. In front of the HDF5 file, in a user block that
// h5py and MATLAB skip, it has
//   off 0   u8[8] "ECHOFUSE" | 8 u32 version of the seal (1)
//   off 12  u32 CRC-32 (zlib's) of all bytes behind the user block
//   off 16  u64 length of the whole file
//   off 24  zeros to byte 512
// and it holds nothing but groups, arrays of numbers and texts of fixed length, uncompressed, each
// linked once by its name. HDF5 reads a checked copy of it, and only after the checksum.
#pragma once
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::record {

using H5Shape = std::vector<std::size_t>;
using H5Value = std::variant<std::string, double, std::int64_t>;

// Threading: HDF5 is not thread-safe; all files of a process belong to one thread at a time. Every
// member throws Error naming the file and the dataset (disk if a write failed, failed otherwise).
class H5File {
 public:
  static H5File create(const std::string& path);  // refuses a path that exists
  static H5File open(const std::string& path);    // read-only: of one's own writing
  static H5File create_sealed(const std::string& path);
  // Refuses what is no such file, as Error(failed): cut off, changed, larger than it says, or of
  // another structure. Of the second form `path` is only a name for messages.
  static H5File open_sealed(const std::string& path);
  static H5File open_sealed(const std::string& path, Bytes contents);
  // Puts the seal in front of a file that HDF5 has closed, as close() does: after an edit.
  static void seal(const std::string& path);
  ~H5File();  // closes; call close() after writing to see errors
  H5File(H5File&& other) noexcept;
  H5File& operator=(H5File&&) = delete;
  void close();
  // A group of it as a file of its own, made if the file is being written. Lives within the file.
  H5File group(const std::string& name) const;

  // Row-major; shape {} is a scalar. Arrays of two or more dimensions are compressed, one chunk
  // for each index of the first dimension; not in a sealed file.
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
  // An attribute of a dataset or group; "." is the file (or group) itself, "/" its root.
  void set(const std::string& object, const std::string& attribute, const H5Value& value);

  bool has(const std::string& name) const;
  H5Shape shape(const std::string& name) const;
  // All values in row-major order, converted to T as HDF5 does between numbers.
  template <class T>
  std::vector<T> read(const std::string& name) const;
  // The same, refused unless they are of type T and of this shape, in which a dimension may be
  // `any`. What a sealed file holds, and takes, are usable numbers: finite, at most 1e18 in size.
  static constexpr std::size_t any = std::numeric_limits<std::size_t>::max();
  template <class T>
  std::vector<T> read(const std::string& name, const H5Shape& expected) const;
  std::string read_text(const std::string& name) const;
  std::vector<std::string> read_texts(const std::string& name) const;
  bool has_attribute(const std::string& object, const std::string& attribute) const;
  template <class T>  // std::string, double or std::int64_t
  T get(const std::string& object, const std::string& attribute) const;
  // Throws Error(failed) that says what of an object is wrong, and what would be right.
  [[noreturn]] void refuse(const std::string& object, const std::string& why) const;

 private:
  H5File(std::string path, std::int64_t file, bool sealed, std::string prefix = {})
      : path_(std::move(path)), file_(file), sealed_(sealed), prefix_(std::move(prefix)) {}
  std::int64_t open_attribute(const std::string& object, const std::string& attribute,
                              int wanted) const;
  template <class T>
  void require_usable(const std::string& name, std::span<const T> values) const;
  std::string checked(const std::string& name, std::string text) const;
  static H5File create_with(const std::string& path, bool sealed);
  std::int64_t text_type(std::size_t length) const;
  void write_strings(const std::string& name, const std::vector<std::string>& texts,
                     const H5Shape& shape);
  [[noreturn]] void fail(const std::string& name, const char* what, bool writing) const;
  std::int64_t dataset(const std::string& name) const;
  std::int64_t make_dataset(const std::string& name, std::int64_t type, const H5Shape& shape);

  std::string path_;
  std::int64_t file_;              // hid_t, negative when closed
  bool sealed_, sealing_ = false;  // sealing: when it is closed
  std::string prefix_;             // of a group's names
};

template <>
std::string H5File::get(const std::string& object, const std::string& attribute) const;
template <>
double H5File::get(const std::string& object, const std::string& attribute) const;
template <>
std::int64_t H5File::get(const std::string& object, const std::string& attribute) const;

}  // namespace echofuse::record
