// SPDX-License-Identifier: MIT
#pragma once
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <utility>
#include <vector>

#include "../fixtures/paths.hpp"
#include "drivers/core/bytes.hpp"

namespace echofuse::test {

// Reads a golden file, which consists of lines of hexadecimal bytes. A line that begins with "#"
// starts a new piece.
inline std::vector<Bytes> read_golden(const std::string& name) {
  const std::string path = echofuse::test::source_dir + "/tests/golden/" + name;
  std::ifstream file(path);
  if (!file) throw std::runtime_error("cannot read " + path);
  std::vector<Bytes> pieces;
  bool begin = true;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with('#')) {
      begin = true;
      continue;
    }
    if (std::exchange(begin, false)) pieces.emplace_back();
    std::istringstream words(line);
    for (std::string word; words >> word;)
      pieces.back().push_back(static_cast<std::uint8_t>(std::stoul(word, nullptr, 16)));
  }
  return pieces;
}

inline Bytes join(const std::vector<Bytes>& pieces) {
  Bytes all;
  for (const Bytes& piece : pieces) all.insert(all.end(), piece.begin(), piece.end());
  return all;
}

inline ByteView view_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace echofuse::test
