// SPDX-License-Identifier: MIT
// Judges the quality of each sensor's data. Pure. A valid sensor's verdict "ok" becomes
//   stands still  the same histogram, profile or frame as in the record before
//   saturated     SPD: more clicks a laser pulse than wanted, the first one hides others
//                 radar: the lobe's top is cut off
//   no peak       SPD: no 5 bins stand out of the mean; radar: no bin of the median
//   weak          SPD: few clicks, or few beside the run's first minute; radar: little power beside
//                 it; depth: few pixels with a return, or few beside it
//   lossy         fewer samples arrived than wanted: radar frames, camera frames, start pulses
// each followed by ": " and the figures. The sensor stays valid: its data are what they are.
#pragma once
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/record.hpp"

namespace echofuse::acquire {

class SignalCheck {
 public:
  // `nominal_hz`: rates of starts, radar frames and camera frames; 0: not known. Depths beyond
  // `far_m` are no return.
  SignalCheck(const SignalLimits& limits, double window_s, PerSensor<double> nominal_hz = {},
              double far_m = record::most_map_far_m);
  // Fills record.signal, but for the clicks a pulse, and judges the sensors that are valid. Records
  // come in order; `axes` are the run's. `ends`: ends of the sensors' recordings. A slot that such
  // an end cuts is expected to contain the samples before it.
  using Ends = PerSensor<std::optional<HostTime>>;
  void judge(record::FusedRecord& record, std::span<const Axis> axes, const Ends& ends = {});

 private:
  // A sensor's signal in the first minute; none until there are five records.
  class Reference {
   public:
    std::optional<double> add(double strength, std::size_t at_most);

   private:
    std::vector<double> values_;
    std::optional<double> median_;
  };
  std::string judge_spd(record::FusedRecord& record, const Axis& axis);
  std::string judge_radar(record::FusedRecord& record, const Axis& axis);
  std::string judge_depth(record::FusedRecord& record);
  std::string beside_reference(Sensor sensor, double strength, const char* what);
  std::string judge_losses(const record::FusedRecord& record, Sensor sensor,
                           std::optional<HostTime> end);

  SignalLimits limits_;
  PerSensor<double> nominal_hz_;
  double far_mm_;
  std::size_t reference_records_;
  PerSensor<Reference> references_, frames_;
  std::vector<std::uint32_t> last_spd_;
  std::vector<float> last_radar_;
  bool radar_was_flat_ = false;  // the last record's lobe had no top
  std::vector<std::uint16_t> last_depth_;
};

// Asks whether the tagger's inputs are swapped if 98 % of the clicks lie outside the histogram, or
// more than four clicks follow each start. Empty otherwise.
std::string swap_question(const TagCounts& counts);

// "ok", "weak", ... of a valid sensor's verdict, "missing" of any other: what a change is told by.
std::string kind_of(const record::FusedRecord& record, Sensor sensor);

}  // namespace echofuse::acquire
