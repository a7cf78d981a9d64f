// SPDX-License-Identifier: MIT
#include "acquire/measurement/detector.hpp"

#include <charconv>
#include <cmath>
#include <limits>

#include "drivers/util/format.hpp"

namespace echofuse::record {
namespace {

constexpr const char* key = "detector_dead_time_ps";
constexpr const char* until_next_pulse = "until the next pulse";
constexpr double longest_ps = 1e12;

}  // namespace

std::pair<std::string, std::string> Detector::meta() const {
  if (std::isinf(dead_time_ps)) return {key, until_next_pulse};
  return {key, format("%.15g", dead_time_ps)};
}

std::optional<Detector> detector_of(const Meta& meta) {
  for (const auto& [name, value] : meta) {
    if (name != key) continue;
    if (value == until_next_pulse) return Detector{std::numeric_limits<double>::infinity()};
    double ps = 0;
    const auto end = std::from_chars(value.data(), value.data() + value.size(), ps);
    if (end.ec == std::errc() && end.ptr == value.data() + value.size() && ps > 0 &&
        ps <= longest_ps)
      return Detector{ps};
  }
  return std::nullopt;
}

}  // namespace echofuse::record
