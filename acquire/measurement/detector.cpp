// SPDX-License-Identifier: MIT
#include "acquire/measurement/detector.hpp"

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
    const auto ps = numbers_in(value);
    if (ps.size() == 1 && ps[0] > 0 && ps[0] <= longest_ps) return Detector{ps[0]};
  }
  return std::nullopt;
}

}  // namespace echofuse::record
