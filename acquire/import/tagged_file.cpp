// SPDX-License-Identifier: MIT
#include "acquire/import/tagged_file.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <ctime>
#include <vector>

#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

struct HeaderTag {
  char name[32];
  std::int32_t index;
  std::uint32_t type;
  std::int64_t value;
};
static_assert(sizeof(HeaderTag) == 48);

constexpr const char* magic = "PQTTTR";
// tyFloat8, tyTDateTime and tyAnsiString in the source code of PicoQuant's PTU demos
constexpr std::uint32_t type_double = 0x20000008, type_time = 0x21000008, type_text = 0x4001ffff;
constexpr std::size_t max_tags = 100'000, longest_text = 4096;

bool is_long(std::uint32_t type) { return (type & 0xffff) == 0xffff; }

std::string until_nul(const char* bytes, std::size_t max_length) {
  return {bytes, std::find(bytes, bytes + max_length, '\0')};
}

}  // namespace

TaggedFile::TaggedFile(const std::string& path) : path_(path), file_(path, ExitCode::failed) {
  char head[16] = {};
  const std::size_t there = file_.read({reinterpret_cast<std::uint8_t*>(head), sizeof head});
  if (there < sizeof head || until_nul(head, 8) != magic)
    throw Error(ExitCode::failed,
                printable(path) + ": is not a PicoQuant file: does not begin with " + magic);
  tag_bytes_ = sizeof head;
  read_tags();
}

void TaggedFile::take(void* to, std::size_t bytes) {
  tag_bytes_ += file_.read({static_cast<std::uint8_t*>(to), bytes});
}

void TaggedFile::read_tags() {
  const std::size_t size = file_.size();
  for (std::size_t count = 0; count < max_tags; ++count) {
    HeaderTag tag;
    if (size - std::min(size, tag_bytes_) < sizeof tag) break;
    take(&tag, sizeof tag);
    const std::string name = until_nul(tag.name, sizeof tag.name);
    if (name == "Header_End") return;
    const bool used = tag.index == -1;
    if (!is_long(tag.type)) {
      if (used)
        numbers_[name] = tag.type == type_double || tag.type == type_time
                             ? std::bit_cast<double>(tag.value)
                             : static_cast<double>(tag.value);
      continue;
    }
    const std::size_t left = size - std::min(size, tag_bytes_);
    if (tag.value < 0 || static_cast<std::uint64_t>(tag.value) > left) break;
    std::vector<char> text(static_cast<std::size_t>(tag.value));
    take(text.data(), text.size());
    if (used && tag.type == type_text)
      texts_[name] = until_nul(text.data(), std::min(text.size(), longest_text));
  }
  throw Error(ExitCode::failed, printable(path_) + ": damaged: the header is not terminated");
}

std::optional<double> TaggedFile::number(const std::string& name) const {
  const auto found = numbers_.find(name);
  return found == numbers_.end() || !std::isfinite(found->second) ? std::nullopt
                                                                  : std::optional(found->second);
}

double TaggedFile::require(const std::string& name) const {
  if (const auto found = number(name)) return *found;
  throw Error(ExitCode::failed, printable(path_) + ": has no header tag " + name);
}

std::int64_t TaggedFile::whole(const std::string& name, std::int64_t minimum,
                               std::int64_t maximum) const {
  const double value = require(name);
  if (value >= static_cast<double>(minimum) && value <= static_cast<double>(maximum))
    return static_cast<std::int64_t>(value);
  throw Error(ExitCode::failed,
              printable(path_) + ": invalid " + name + ": " + std::to_string(value));
}

std::string TaggedFile::text(const std::string& name) const {
  const auto found = texts_.find(name);
  return found == texts_.end() ? "" : found->second;
}

bool TaggedFile::is_repeated(const std::string& name) const {
  const auto first = time(name);
  if (!first) return false;
  const auto whole_s = std::chrono::duration_cast<std::chrono::seconds>(*first).count();
  const auto hour_of = [](std::time_t at) {
    std::tm local{};
    localtime_r(&at, &local);
    return 60 * local.tm_hour + local.tm_min;
  };
  constexpr std::time_t hour_s = 3600;
  return hour_of(whole_s) == hour_of(whole_s + hour_s) ||
         hour_of(whole_s) == hour_of(whole_s - hour_s);
}

std::optional<UtcTime> TaggedFile::time(const std::string& name) const {
  // The day numbers begin at 1899-12-30, because the tag has the type TDateTime of Delphi.
  constexpr double day_of_1970 = 25569, day_of_2250 = 127'839, day_s = 86400;
  const auto days = number(name);
  if (!days || *days < day_of_1970 || *days > day_of_2250) return std::nullopt;
  // Rounds to 1 ms, which removes the rounding error (below 10 us) of a double that stores days.
  const double since_s = std::round((*days - day_of_1970) * day_s * 1e3) / 1e3;
  const auto whole_s = static_cast<std::time_t>(since_s);
  std::tm local{};
  gmtime_r(&whole_s, &local);
  local.tm_isdst = -1;
  return std::chrono::seconds(std::mktime(&local)) +
         std::chrono::milliseconds(std::lround(1e3 * (since_s - static_cast<double>(whole_s))));
}

}  // namespace echofuse::acquire
