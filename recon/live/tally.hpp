// SPDX-License-Identifier: MIT
// Sums one or more records. Computes their histogram, mean range profile, rates and peak fits.
#pragma once
#include <cstdint>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "acquire/record/fused_record.hpp"

namespace echofuse::view {

// Range in which the highest peak is fitted, m.
struct FitRange {
  double from_m = -std::numeric_limits<double>::infinity();
  double to_m = std::numeric_limits<double>::infinity();
};

class Tally {
 public:
  // Adds the SPD and radar data of a record, or subtracts them if `sign` is -1.
  void add(const record::FusedRecord& record, const std::vector<Axis>& axes, int sign = 1);
  const std::vector<double>& clicks() const { return clicks_; }  // per bin; empty if no SPD data
  // Returns the mean range profile in dB; empty if there are no radar data.
  std::vector<float> profile_db(const std::vector<Axis>& axes) const;
  // Returns {"rates": {sync_hz, pulse_hz, click_hz, dark_hz, clicks_per_pulse}, "spd_records":
  // number of records with SPD data, "fits": {spd, radar: {centre_m, error_m, fwhm_m}}}. Unknown
  // values are null. sync_hz: received sync signals per second. pulse_hz: laser pulses per second,
  // which exceed sync_hz if the tagger has a conditional filter; equal to `laser_hz`, or estimated
  // if `laser_hz` is 0; unknown if any record has too few clicks for the estimate. dark_hz: number
  // of clicks in the bins before the first return, divided by the total time for which these bins
  // were open.
  nlohmann::json numbers(const std::vector<Axis>& axes, double laser_hz = 0,
                         const FitRange& range = {}) const;

 private:
  nlohmann::json rates(const Axis& axis, double laser_hz) const;
  std::vector<double> clicks_, power_;
  double spd_records_ = 0, radar_records_ = 0;
  double unknown_pulses_ = 0;  // number of SPD records with an unknown number of laser pulses
  // Sums over all records that contain SPD data: slots_s_ in s, the others are counts.
  double slots_s_ = 0, starts_ = 0, all_clicks_ = 0, pulses_ = 0;
};

}  // namespace echofuse::view
