// SPDX-License-Identifier: MIT
#include "acquire/run/disk_estimate.hpp"

#include <sys/statvfs.h>

#include <algorithm>
#include <cstdio>
#include <iterator>

#include "acquire/measurement/radar_array.hpp"
#include "drivers/program/console.hpp"

namespace echofuse::acquire {
namespace {

constexpr double row_bytes = 2048;        // of a record beside its sensors' data, with events
constexpr double fixed_bytes = 16 << 20;  // the WAL, and the tables of a run without records

}  // namespace

DiskEstimate estimate_disk(const PlannedRun& plan, double free_bytes) {
  DiskEstimate out{.record_bytes = plan.record_bytes + row_bytes};
  if (plan.count)
    out.needed_bytes = static_cast<double>(*plan.count) * out.record_bytes + fixed_bytes;
  out.lasts_s = std::max(0.0, (free_bytes - fixed_bytes) / out.record_bytes) * plan.window_s;
  return out;
}

double record_bytes(const std::vector<Axis>& axes) {
  double bytes = 0, pixels = 0;
  for (const Axis& axis : axes) {
    if (axis.name == "array") bytes += record::array_bytes(axis);
    if (axis.name == "spd" || axis.name == "radar") bytes += 4.0 * axis.count;
    if (axis.name == "depth_x" || axis.name == "depth_y")
      pixels = (pixels > 0 ? pixels : 1) * axis.count;
  }
  return bytes + 2 * pixels;
}

std::optional<std::uint64_t> free_bytes(const std::string& folder) {
  struct statvfs disk {};
  if (::statvfs(folder.c_str(), &disk) != 0) return std::nullopt;
  return std::uint64_t{disk.f_bavail} * disk.f_frsize;
}

std::string size_text(double bytes) {
  constexpr const char* units[] = {"B", "kB", "MB", "GB", "TB"};
  std::size_t unit = 0;
  for (; bytes >= 1000 && unit + 1 < std::size(units); ++unit) bytes /= 1000;
  char text[32];
  std::snprintf(text, sizeof text, bytes < 10 ? "%.1f %s" : "%.0f %s", bytes, units[unit]);
  return text;
}

std::string disk_warning(const PlannedRun& plan, double free_bytes) {
  constexpr double day_s = 86'400;
  const DiskEstimate estimate = estimate_disk(plan, free_bytes);
  if (plan.count) {
    if (estimate.needed_bytes <= free_bytes) return {};
    return std::to_string(*plan.count) + " records need up to " + size_text(estimate.needed_bytes) +
           ", " + size_text(free_bytes) +
           " are free; the run ends as stopped:disk when the disk is "
           "full";
  }
  if (estimate.lasts_s >= day_s) return {};
  return "the disk is full after about " + human_duration(estimate.lasts_s) + " of this run";
}

}  // namespace echofuse::acquire
