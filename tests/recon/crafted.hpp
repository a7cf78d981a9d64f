// SPDX-License-Identifier: MIT
// Builds invalid model files: changes the header, metadata or values, and corrects the checksum.
// Does not use Catch, because a fuzz target includes this file.
#pragma once
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "drivers/core/bytes.hpp"
#include "drivers/core/crc32c.hpp"

namespace echofuse::crafted {

// Returns a model file that consists of the given header and tensor values. If the header contains
// a checksum, the checksum is corrected.
inline Bytes sealed(const std::string& header, ByteView values) {
  Bytes out(8 + header.size() + values.size());
  const std::uint64_t length = header.size();
  std::memcpy(out.data(), &length, sizeof length);
  std::copy(header.begin(), header.end(), out.begin() + 8);
  std::copy(values.begin(), values.end(), out.end() - std::ssize(values));
  const std::string mark = "\"crc32c\":\"";
  const auto found = header.find(mark);
  if (found == std::string::npos || header.size() < found + mark.size() + 8) return out;
  const auto digits = out.begin() + static_cast<std::ptrdiff_t>(8 + found + mark.size());
  std::fill_n(digits, 8, std::uint8_t{'0'});
  char right[9] = {};
  std::snprintf(right, sizeof right, "%08x", static_cast<unsigned>(crc32c(out)));
  std::copy_n(right, 8, digits);
  return out;
}

// Contents of a trained model file, in a form that tests can modify.
struct Model {
  nlohmann::json head;   // tensor entries of the header; the key is the name of the tensor
  nlohmann::json facts;  // metadata of the model; the key is the name of the item
  Bytes values;

  explicit Model(ByteView file) {
    std::uint64_t length = 0;
    std::memcpy(&length, file.data(), sizeof length);
    const ByteView text = file.subspan(8, length), behind = file.subspan(8 + length);
    head = nlohmann::json::parse(text.begin(), text.end());
    facts = nlohmann::json::parse(head["__metadata__"]["facts"].get<std::string>());
    head.erase("__metadata__");
    values.assign(behind.begin(), behind.end());
  }

  std::string header() const {
    nlohmann::json out = head;
    out["__metadata__"] = {{"crc32c", "00000000"}, {"facts", facts.dump()}};
    return out.dump();
  }
  Bytes sealed() const { return crafted::sealed(header(), values); }

  std::vector<std::string> tensors() const {
    std::vector<std::string> out;
    for (const auto& [name, entry] : head.items()) out.push_back(name);
    return out;
  }
  std::vector<std::string> names_of_facts() const {
    std::vector<std::string> out;
    for (const auto& [name, fact] : facts.items()) out.push_back(name);
    return out;
  }
  std::size_t begin_of(const std::string& name) const { return head[name]["data_offsets"][0]; }
  std::size_t end_of(const std::string& name) const { return head[name]["data_offsets"][1]; }

  // Overwrites the first value of a tensor.
  template <class T>
  void set_first(const std::string& name, T value) {
    std::memcpy(values.data() + begin_of(name), &value, sizeof value);
  }
  // Adds a header entry for a tensor. The data of the tensor are the bytes from `begin` to `end` in
  // `values`.
  void add(const std::string& name, const std::string& type, const std::vector<std::size_t>& shape,
           std::size_t begin, std::size_t end) {
    head[name] = {{"dtype", type}, {"shape", shape}, {"data_offsets", {begin, end}}};
  }
  // Replaces a tensor with a tensor of another type and shape. The new data consist of `bytes`
  // copies of `fill` and are appended to `values`.
  void replace(const std::string& name, const std::string& type,
               const std::vector<std::size_t>& shape, std::size_t bytes, std::uint8_t fill) {
    const std::size_t from = begin_of(name), length = end_of(name) - from;
    const auto at = values.begin() + static_cast<std::ptrdiff_t>(from);
    values.erase(at, at + static_cast<std::ptrdiff_t>(length));
    for (auto& [other, entry] : head.items())
      for (auto& offset : entry["data_offsets"])
        if (offset.get<std::size_t>() >= from + length && length > 0)
          offset = offset.get<std::size_t>() - length;
    add(name, type, shape, values.size(), values.size() + bytes);
    values.resize(values.size() + bytes, fill);
  }
};

}  // namespace echofuse::crafted
