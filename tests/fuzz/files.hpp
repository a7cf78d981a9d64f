// SPDX-License-Identifier: MIT
// Divides inputs into files, for targets that read files.
#pragma once
#include <array>
#include <filesystem>
#include <fstream>
#include <map>
#include <utility>

#include "drivers/util/npy.hpp"
#include "fuzz.hpp"

namespace echofuse::fuzz {

// Temporary folder, kept in memory if /dev/shm exists. The destructor removes the folder.
class Folder {
 public:
  Folder() {
    const bool shared = std::filesystem::is_directory("/dev/shm");
    std::string name = std::string(shared ? "/dev/shm" : "/tmp") + "/echofuse-fuzz-XXXXXX";
    require(mkdtemp(name.data()), "a folder can be made");
    path_ = name;
  }
  ~Folder() { std::filesystem::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  const std::string& path() const { return path_; }
  void write(const std::string& name, std::string_view contents) const {
    std::ofstream(path_ + "/" + name, std::ios::binary | std::ios::trunc) << contents;
  }
  void write(const std::string& name, ByteView contents) const { write(name, text_of(contents)); }
  void clear() const {
    for (const auto& entry : std::filesystem::directory_iterator(path_))
      std::filesystem::remove_all(entry);
  }

 private:
  std::string path_;
};

// An input contains several files. Each file begins with a line that starts with "@@" and a letter.
// The letter selects the file name.
inline constexpr std::string_view file_mark = "\n@@";
inline std::map<char, ByteView> files_of(ByteView input) {
  std::map<char, ByteView> out;
  const std::string_view text = text_of(input);
  for (std::size_t at = text.find(file_mark); at < text.size();) {
    const std::size_t name = at + file_mark.size();
    const std::size_t end = std::min(text.find(file_mark, name), text.size());
    if (name < end) out[text[name]] = input.subspan(name + 1, end - name - 1);
    at = end;
  }
  return out;
}

// Replaces the contents of the folder with the files that `names` lists by their letters.
using FileNames = std::initializer_list<std::pair<char, const char*>>;
inline void write_files(const Folder& folder, const std::map<char, ByteView>& files,
                        FileNames names) {
  folder.clear();
  for (const auto& [letter, name] : names)
    if (files.contains(letter)) folder.write(name, files.at(letter));
}

// Returns a valid .npy file. The recipe begins with the type, the number of dimensions and the size
// of each dimension, each stored as a u8. The remaining bytes are repeated or truncated to fill the
// array.
inline Bytes npy_of(ByteView recipe) {
  constexpr std::array types{"<f4", "<f8", "|u1", "<u2", "<u4", "<i8", "|b1", "<i2"};
  constexpr std::array bytes{4, 8, 1, 2, 4, 8, 1, 2};
  ByteReader in(recipe);
  const std::size_t type = in.get<std::uint8_t>() % types.size();
  const std::size_t dimensions = in.get<std::uint8_t>() % 4;
  const std::size_t rows = in.get<std::uint8_t>() % 8;
  std::size_t values = rows;
  std::vector<std::size_t> shape;
  for (std::size_t i = 1; i < dimensions; ++i) {
    shape.push_back(in.get<std::uint8_t>() % 16);
    values *= shape.back();
  }
  const std::string header = npy_header(types[type], rows, shape);
  Bytes out(header.begin(), header.end());
  const ByteView given = in.take(in.left());
  for (std::size_t i = 0; i < values * static_cast<std::size_t>(bytes[type]); ++i)
    out.push_back(given.empty() ? std::uint8_t{0} : given[i % given.size()]);
  return out;
}

}  // namespace echofuse::fuzz
