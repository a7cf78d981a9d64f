// SPDX-License-Identifier: MIT
// The single-photon detector as the run's meta names it, for the correction of pile-up on reading.
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::record {

using Meta =
    std::vector<std::pair<std::string, std::string>>;  // names and texts, in the order given

struct Detector {
  double dead_time_ps = 0;  // after a click; 0: not known; infinite: until the laser's next pulse

  bool known() const { return dead_time_ps > 0; }
  std::pair<std::string, std::string> meta() const;  // entries of a known detector
};

// None if the run says nothing of it, or what cannot be.
std::optional<Detector> detector_of(const Meta& meta);

}  // namespace echofuse::record
