// SPDX-License-Identifier: MIT
// Dead time of the single-photon detector in the metadata of a run, for the correction of pile-up.
#pragma once
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::record {

// Maximum plausible rate of clicks in a bin, 1/s. It is higher than the maximum rate of any
// detector or time tagger. Exposures and records with a higher rate are damaged.
inline constexpr double max_clicks_per_s = 1e8;

using Meta = std::vector<std::pair<std::string, std::string>>;  // metadata entries, in file order

struct Detector {
  // Dead time after a click; 0 if unknown; infinite if it ends at the next laser pulse.
  double dead_time_ps = 0;

  bool known() const { return dead_time_ps > 0; }
  // Returns the metadata entry with the dead time. May be called only if known() is true.
  std::pair<std::string, std::string> meta() const;
};

// Returns the detector described by the metadata; nullopt if the dead time is missing or invalid.
std::optional<Detector> detector_of(const Meta& meta);

}  // namespace echofuse::record
