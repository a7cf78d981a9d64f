// SPDX-License-Identifier: MIT
#include "acquire/room.hpp"

#include <sys/statvfs.h>

#include <cstdio>
#include <filesystem>

namespace echofuse::acquire {
namespace {

constexpr std::uint64_t row_bytes = 1000;     // the columns without the sensors' data
constexpr std::uint64_t wal_bytes = 4 << 20;  // SQLite folds it back every 1000 pages of 4 KiB

std::string megabytes(std::uint64_t bytes) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f MB", static_cast<double>(bytes) / 1e6);
  return text;
}

}  // namespace

std::uint64_t record_bytes(const std::vector<Axis>& axes) {
  std::uint64_t bytes = row_bytes, pixels = 1;
  bool depth = false;
  for (const Axis& axis : axes) {
    if (axis.name == "spd" || axis.name == "radar") bytes += 4ULL * axis.count;
    if (axis.name != "depth_x" && axis.name != "depth_y") continue;
    pixels *= axis.count;
    depth = true;
  }
  return bytes + (depth ? 2 * pixels : 0);
}

std::optional<std::uint64_t> free_bytes(const std::string& run) {
  struct statvfs disk {};
  const auto folder = std::filesystem::path(run).parent_path();
  if (statvfs(folder.c_str(), &disk) != 0) return std::nullopt;
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

std::string room_warning(std::uint64_t bytes_per_record, std::optional<std::int64_t> count,
                         double window_s, std::uint64_t free) {
  if (count) {
    const std::uint64_t need = static_cast<std::uint64_t>(*count) * bytes_per_record + wal_bytes;
    if (need <= free) return {};
    return std::to_string(*count) + " records need up to " + megabytes(need) + ", free are " +
           megabytes(free) + "; the run will end as stopped:disk when the disk is full";
  }
  const double hours =
      static_cast<double>(free) / static_cast<double>(bytes_per_record) * window_s / 3600;
  if (hours >= 24) return {};
  char text[120];
  std::snprintf(text, sizeof text, "the disk is full after about %.1f hours of this run", hours);
  return text;
}

std::string room_warning(const std::string& run, const std::vector<Axis>& axes,
                         std::optional<std::int64_t> count, double window_s) {
  const auto free = free_bytes(run);
  return free ? room_warning(record_bytes(axes), count, window_s, *free) : "";
}

}  // namespace echofuse::acquire
