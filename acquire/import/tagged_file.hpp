// SPDX-License-Identifier: MIT
// Header of PicoQuant's tagged files (.ptu). Source: PicoQuant's demos
// (PicoQuant-Time-Tagged-File-Format-Demos, Read_PTU.py). Little-endian:
//   u8[8] "PQTTTR", u8[8] version, then tags up to the one named Header_End:
//   char[32] name, i32 index (-1: none), u32 type, 8 bytes of value; for types that end with ffff
//   the value is the number of bytes that follow. Records follow the tags.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "drivers/core/clock.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::acquire {

class TaggedFile {
 public:
  // Reads the tags of the header. Throws Error(failed) if the file is not a PicoQuant file or a tag
  // is damaged.
  explicit TaggedFile(const std::string& path);

  // Returns the number in a tag that has no index; no value if the tag is missing or contains no
  // finite number.
  std::optional<double> number(const std::string& name) const;
  // Returns the number in a tag. If it is missing, throws Error(failed) with the name of the tag.
  double require(const std::string& name) const;
  // Returns the number in a tag as an integer. Throws Error(failed) if it is missing or not between
  // `minimum` and `maximum`.
  std::int64_t whole(const std::string& name, std::int64_t minimum, std::int64_t maximum) const;
  std::string text(const std::string& name) const;  // text of the tag; empty if the tag is missing
  // Returns the time in a tag. The file contains local time in days since 1899-12-30, which is
  // interpreted in the time zone of this machine. Returns no value if the tag is missing or its
  // time is not between 1970 and 2250.
  std::optional<UtcTime> time(const std::string& name) const;
  // Returns true if the local time in the tag occurred twice because summer time ended.
  bool is_repeated(const std::string& name) const;
  const std::string& path() const { return path_; }
  const RegularFile& file() const { return file_; }  // positioned at the end of the tags

 private:
  void read_tags();
  void take(void* to, std::size_t bytes);
  std::string path_;
  RegularFile file_;
  std::size_t tag_bytes_ = 0;
  std::map<std::string, double> numbers_;
  std::map<std::string, std::string> texts_;
};

}  // namespace echofuse::acquire
