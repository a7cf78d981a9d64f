// SPDX-License-Identifier: MIT
// Judges the quality of each sensor's data. Pure. Replaces a valid sensor's verdict "ok" by
//   stands still  same histogram, profile or frame as in the previous record
//   saturated     SPD: too many clicks per laser pulse (pile-up)
//                 radar: the top of the lobe is clipped
//   no peak       SPD: no 5 bins exceed the mean; radar: no bin exceeds the median
//   weak          SPD: few clicks, or few relative to the run's first minute; radar: little power
//                 relative to it; depth: few pixels with a return, or few relative to it
//   lossy         too few samples received: radar frames, camera frames, start pulses
// followed by ": " and figures. The sensor stays valid; its data are not changed.
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
  // `nominal_hz`: rates of starts, radar frames and camera frames; 0: unknown. Depths beyond
  // `far_m` are treated as no return.
  SignalCheck(const SignalLimits& limits, double window_s, PerSensor<double> nominal_hz = {},
              double far_m = record::most_map_far_m);
  // Fills record.signal, except clicks_a_pulse, and sets the verdicts of valid sensors. Call in
  // record order; `axes`: those of the run. `ends`: ends of the sensors' recordings. A slot that
  // such an end cuts is expected to contain the samples before it.
  using RecordingEnds = PerSensor<std::optional<HostTime>>;
  void assess(record::FusedRecord& record, std::span<const Axis> axes,
              const RecordingEnds& ends = {});

 private:
  // A sensor's signal in the first minute; unknown before five records.
  class Reference {
   public:
    std::optional<double> add(double strength, std::size_t at_most);

   private:
    std::vector<double> values_;
    std::optional<double> median_;
  };
  std::string assess_spd(record::FusedRecord& record, const Axis& axis);
  std::string assess_radar(record::FusedRecord& record, const Axis& axis);
  std::string assess_depth(record::FusedRecord& record);
  std::string beside_reference(Sensor sensor, double strength, const char* what);
  std::string assess_losses(const record::FusedRecord& record, Sensor sensor,
                            std::optional<HostTime> end);

  SignalLimits limits_;
  PerSensor<double> nominal_hz_;
  double far_mm_;
  std::size_t reference_records_;
  PerSensor<Reference> references_, frames_;
  std::vector<std::uint32_t> last_spd_;
  std::vector<float> last_radar_;
  bool radar_was_flat_ = false;  // the previous record's lobe was clipped
  std::vector<std::uint16_t> last_depth_;
};

// Returns a hint that the tagger's inputs may be swapped if at least 98 % of the clicks are outside
// the histogram, or more than four clicks follow each start; otherwise empty.
std::string swap_question(const TagCounts& counts);

// Returns "ok", "weak", ... for a valid sensor, "missing" otherwise; used to detect changes.
std::string kind_of(const record::FusedRecord& record, Sensor sensor);

}  // namespace echofuse::acquire
