// SPDX-License-Identifier: MIT
// What a run says of its single-photon detector in its table meta, for who corrects the pile-up on
// reading.
#pragma once
#include <optional>
#include <string>
#include <utility>

#include "acquire/record/record.hpp"

namespace echofuse::record {

struct Detector {
  double dead_time_ps = 0;  // after a click; 0: not known; infinite: until the laser's next pulse

  bool known() const { return dead_time_ps > 0; }
  std::pair<std::string, std::string> meta() const;  // of one that is known
};

// None if the run says nothing of it, or what cannot be.
std::optional<Detector> detector_of(const RunInfo& info);

}  // namespace echofuse::record
