// SPDX-License-Identifier: MIT
// Single-photon detector as stated in the run's meta, for the pile-up correction on reading.
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::record {

using Meta = std::vector<std::pair<std::string, std::string>>;  // names and texts, in file order

struct Detector {
  double dead_time_ps = 0;  // after a click; 0: unknown; infinite: until the next laser pulse

  bool known() const { return dead_time_ps > 0; }
  std::pair<std::string, std::string> meta() const;  // meta entries of a known detector
};

// Returns nullopt if the run states no detector, or an impossible one.
std::optional<Detector> detector_of(const Meta& meta);

}  // namespace echofuse::record
