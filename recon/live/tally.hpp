// SPDX-License-Identifier: MIT
// Sum of one or more records: histogram, mean range profile, rates and fits.
#pragma once
#include <cstdint>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <vector>

#include "acquire/record/run_file.hpp"

namespace echofuse::view {

// Range in which peaks are fitted, m.
struct FitRange {
  double from_m = -std::numeric_limits<double>::infinity();
  double to_m = std::numeric_limits<double>::infinity();
};

class Tally {
 public:
  // Adds a record's SPD and radar; `sign` -1 subtracts them.
  void add(const record::FusedRecord& record, const std::vector<Axis>& axes, int sign = 1);
  const std::vector<double>& clicks() const { return clicks_; }        // by bin; empty without SPD
  std::vector<float> profile_db(const std::vector<Axis>& axes) const;  // empty without radar
  // {"rates": {sync_hz, pulse_hz, click_hz, dark_hz, clicks_a_pulse}, "spd_records": number of
  // records with SPD, "fits": {spd, radar: {centre_m, error_m, fwhm_m}}}; unknown values are null.
  // sync_hz counts received syncs. Behind a conditional filter there are more pulses: pulse_hz is
  // `laser_hz`, or an estimate if that is 0. dark_hz: clicks before the first return, per second of
  // the observed time.
  nlohmann::json numbers(const std::vector<Axis>& axes, double laser_hz = 0,
                         const FitRange& range = {}) const;

 private:
  nlohmann::json rates(const Axis& axis, double laser_hz) const;
  std::vector<double> clicks_, power_;
  double spd_records_ = 0, radar_records_ = 0;
  double slots_s_ = 0, starts_ = 0, all_clicks_ = 0, pulses_ = 0;  // sums over records with SPD
};

}  // namespace echofuse::view
