// SPDX-License-Identifier: MIT
// PicoQuant's tagged files, .ptu. Source: PicoQuant's demos for these files
// (PicoQuant-Time-Tagged-File-Format-Demos, Read_PTU.py). Little-endian:
//   u8[8] "PQTTTR", u8[8] version, then tags up to the one named Header_End:
//   char[32] name, i32 index (-1: none), u32 type, 8 bytes of value; of the types with ffff at
//   their end the value is the number of bytes that follow. After the tags: records.
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
  // Reads the tags. Throws Error(failed): it is no such file, or its tags are damaged.
  explicit TaggedFile(const std::string& path);

  // Number of a tag without an index; none if there is no such tag, or it has no number.
  std::optional<double> number(const std::string& name) const;
  // Number of a tag; throws Error(failed) that names the tag.
  double require(const std::string& name) const;
  // A whole number from `least` to `most`; else throws as well.
  std::int64_t whole(const std::string& name, std::int64_t least, std::int64_t most) const;
  std::string text(const std::string& name) const;  // empty if there is none
  // Time of a tag. The files store local days since 1899-12-30, read in this machine's time zone.
  // None if the tag is missing or its time is not between 1970 and 2250.
  std::optional<UtcTime> time(const std::string& name) const;
  // Whether that local time came twice, as summer time ended.
  bool came_twice(const std::string& name) const;
  const std::string& path() const { return path_; }
  const RegularFile& file() const { return file_; }  // positioned where the tags end

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
