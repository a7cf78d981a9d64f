// SPDX-License-Identifier: MIT
// Checks the quality of each sensor's data. Does no I/O. If the quality is poor, replaces the
// verdict "ok" of a valid sensor (acquire/measurement/verdict.hpp). The sensor stays valid, and its
// data are not changed.
#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/fused_record.hpp"

namespace echofuse::acquire {

class SignalCheck {
 public:
  // `nominal_hz` contains the rates of start pulses, radar frames and camera frames in Hz; 0 if
  // unknown. Depths beyond `far_m` are treated as "no return".
  SignalCheck(const SignalLimits& limits, double window_s, PerSensor<double> nominal_hz = {},
              double far_m = record::max_map_far_m);
  // Fills `record.signal` except `clicks_per_pulse`, and sets the verdicts of valid sensors. Must
  // be called for each record in order. `axes` contains the axes of the run, and `ends` the times
  // at which the recordings of the sensors end. If a recording ends within the slot, samples are
  // expected only up to that time.
  using RecordingEnds = PerSensor<std::optional<HostTime>>;
  void assess(record::FusedRecord& record, std::span<const Axis> axes,
              const RecordingEnds& ends = {});

 private:
  // Median strength of a sensor's signal in the first minute of the run; no value until five
  // records are available.
  class Reference {
   public:
    std::optional<double> add(double strength, std::size_t at_most);

   private:
    std::vector<double> values_;
    std::optional<double> median_;
  };
  record::Verdict assess_spd(record::FusedRecord& record, const Axis& axis);
  record::Verdict assess_radar(record::FusedRecord& record, const Axis& axis);
  record::Verdict assess_depth(record::FusedRecord& record);
  record::Verdict compare_with_reference(Sensor sensor, double strength, const char* what);
  record::Verdict assess_losses(const record::FusedRecord& record, Sensor sensor,
                                std::optional<HostTime> end);

  SignalLimits limits_;
  PerSensor<double> nominal_hz_;
  double far_mm_;
  std::size_t reference_records_;
  PerSensor<Reference> references_, frames_;
  std::vector<std::uint32_t> last_spd_;
  std::vector<float> last_radar_;
  bool radar_was_flat_ = false;  // true if the top of the lobe was clipped in the previous record
  std::vector<std::uint16_t> last_depth_;
};

// Returns a hint that the start and click inputs of the tagger may be swapped, if at least 98 % of
// the clicks are outside the histogram or there are more than four clicks per start; otherwise an
// empty string.
std::string swap_question(const TagCounts& counts);

}  // namespace echofuse::acquire
