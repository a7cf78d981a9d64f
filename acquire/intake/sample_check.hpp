// SPDX-License-Identifier: MIT
// Checks the samples of histogramming boards, radars and cameras for mistakes of the sender. Import
// uses the same limits for arrays. Each fault is reported once. Uses no clock, device or file.
//   histogram  exposures are longer than a slot, or add up to more than the time between them;
//              counts fall in no bin over ten exposures; a bin contains more counts than a detector
//              can send, so that the exposure is lost
//   profile    power in dB; zeros in all bins, which are no profile
//   depth      depths in other units
//   axis       ranges or tangents in other units; zones of the same direction
//   clock      the device clock stands still or runs at another rate than the host clock
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "acquire/intake/clock_rate.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

// Returns the fault of a map with this median of the depths, or an empty string.
std::string fault_of_depths(double median_mm);

class SampleCheck {
 public:
  using Report = std::function<void(Sensor, const std::string&)>;
  SampleCheck(double window_s, Report report) : window_s_(window_s), report_(std::move(report)) {}

  // Returns false if the histogram is lost. It is then included in the next `lost_before`.
  bool take(HistogramFrame& frame);
  void take(RadarFrame& frame);  // removes a profile of zeros and its heat map
  void take(const DepthFrame& frame);
  void take(const Axis& axis);
  // Returns false if a bin contains more counts than a detector can send in the exposure.
  bool take(const std::vector<std::uint32_t>& counts, double exposure_s);
  // Reports the faults that have not been reported because there were few samples.
  void finish();

 private:
  void once(const char* fault, Sensor sensor, const std::string& text);
  void check_exposures(const HistogramFrame& frame);
  void check_clock(Sensor sensor, std::uint64_t ticks, HostTime received);

  double window_s_;
  Report report_;
  std::vector<std::uint32_t> last_counts_;
  // First of the exposures that are compared with the time between them.
  struct ExposureEnd {
    HostTime received;
    std::uint64_t device_time_us;
  };
  std::optional<ExposureEnd> first_;
  std::uint64_t lost_ = 0, rises_ = 0, exposures_ = 0, exposed_us_ = 0, brief_ = 0, last_us_ = 0;
  std::size_t profiles_ = 0, like_db_ = 0, maps_ = 0;
  std::set<std::pair<std::string_view, Sensor>> reported_;
  // Histograms and depth images have device times in us, profiles in cycles of 32 bits.
  PerSensor<ClockRate> clocks_{ClockRate{1e-6}, ClockRate{1 / RadarFrame::clock_hz, 32},
                               ClockRate{1e-6}};
};

}  // namespace echofuse::acquire
