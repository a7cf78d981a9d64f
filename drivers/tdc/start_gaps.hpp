// SPDX-License-Identifier: MIT
// How many of the laser's pulses a time tagger passes on. A conditional filter keeps the starts
// that have no click in the device, so clicks a start say nothing of how bright the light is; the
// gaps between starts do. Pure.
#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "drivers/core/sample.hpp"

namespace echofuse::tdc {

class StartGaps {
 public:
  explicit StartGaps(std::int32_t start_channel) : channel_(start_channel) {}

  // The first 100,000 gaps are looked at.
  void add(std::span<const Tag> tags);
  // Tags are missing in between.
  void forget_start() { has_last_ = false; }
  // Share of the pulses whose start arrives: of the starts, those that the laser's next pulse
  // follows. 1 without a filter; with one, the chance of a click, as no pulse knows of another.
  // Below 0.5 % it is too high, but stays near 1 %. None if fewer than 20 starts are followed so.
  std::optional<double> share() const;
  // Clicks a laser pulse, of so many clicks and starts that came; none if the share is not known.
  std::optional<double> clicks_a_pulse(std::uint64_t clicks, std::uint64_t starts) const;

 private:
  std::int32_t channel_;
  bool has_last_ = false;
  std::uint64_t last_ps_ = 0;
  std::vector<std::int64_t> gaps_ps_;
};

}  // namespace echofuse::tdc
