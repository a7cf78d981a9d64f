// SPDX-License-Identifier: MIT
// One row of a run: what the three sensors saw in one slot.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/core/tag_counts.hpp"

namespace echofuse::record {

// Coverage of the slot by one sensor. Times are those at which samples were taken: the device's, by
// the fit of its clock to the host's. Without a fit they are times of receipt.
struct SensorSync {
  double offset_s = 0;              // mean time of what was used, minus the slot's centre
  double span_s = 0;                // last minus first time of what was used
  std::uint64_t used = 0;           // SPD: clicks in the histogram; radar, depth: frames
  std::uint64_t lost = 0;           // tags, radar frames, depth frames known to be missing
  std::string verdict = "missing";  // "ok", or why the sensor is not valid
};

// Fit of a device's clock to the host's, by the receipts of its samples.
struct ClockState {
  double offset_s = 0;        // host time minus device time, at the slot's centre
  double drift_ppm = 0;       // above 0: the device's clock is fast
  double residual_s = 0;      // mean distance of the least delayed samples from the fit
  std::uint64_t samples = 0;  // that the fit stands for
};

// Strength of each sensor's signal; none where unknown. Ranges are raw.
struct Signal {
  std::optional<double> clicks_a_pulse;          // per laser pulse, also if only some starts arrive
  std::optional<double> spd_clicks, spd_peak_m;  // clicks above the background; highest bin
  std::optional<double> radar_snr_db, radar_peak_m;  // highest bin over the median bin; where
  std::optional<double> depth_share;                 // pixels with a return / all pixels

  bool operator==(const Signal&) const = default;
};
// Limit of pile-up: above it the first photon of a pulse hides later ones.
inline constexpr double most_clicks_a_pulse = 0.05;

// Kept of every record, for audits.
struct SlotStatistics {
  std::uint64_t radar_frames = 0, depth_frames = 0;     // all that arrived in it
  std::optional<std::uint32_t> radar_last, depth_last;  // the number of the last of them
  double closed_late_s = 0;                             // after its end and grace
};

// Places of RadarTemperature on the chip.
inline constexpr const char* temperature_places[] = {"rx0", "rx1", "rx2", "rx3",  "tx0",
                                                     "tx1", "tx2", "pm",  "dig0", "dig1"};

struct FusedRecord {
  std::int64_t index = 0;
  HostTime slot_start{}, slot_end{};
  UtcTime slot_utc{};  // start of the slot
  SensorSet valid;
  std::string label;
  std::vector<std::uint32_t> spd;  // counts per bin; empty if the sensor is missing
  std::vector<float> radar;        // in the units of the run's radar axis
  // Statistics of the virtual antennas (radar_array.hpp) over array_frames frames; empty if the
  // radar sends none.
  std::vector<float> array;
  std::uint64_t array_frames = 0;
  std::vector<std::uint16_t> depth_mm;  // z, row-major on the run's depth axes, 0 = no return
  TagCounts spd_counts;                 // all tags of the slot
  PerSensor<SensorSync> sync;
  Signal signal;
  SensorSet missing;  // sensors that the run requires and this record has not
  PerSensor<std::optional<ClockState>> clocks;  // none where samples were placed by their receipt
  SlotStatistics statistics;
  // Values of the slot's last radar frame that had them. A temperature that the chip calls invalid
  // is left out.
  std::optional<RadarStats> radar_stats;
  std::optional<RadarTemperature> radar_temperature;

  bool has(Sensor s) const { return valid.contains(s); }
};

// Tags, radar frames and depth frames that came after the slots with these numbers were closed.
using LateCounts = std::map<std::int64_t, PerSensor<std::uint64_t>>;

struct CalibrationEntry {
  Sensor sensor{};
  std::string date_utc, method;
  double distance_m = 0, offset_m = 0, standard_error_m = 0;
  std::string model = {}, serial = {};  // identity of the device; not kept in a run

  bool operator==(const CalibrationEntry&) const = default;
};

// The row of the table run.
struct RunInfo {
  std::string uuid;                    // made by the writer
  std::string started_utc, ended_utc;  // ISO 8601
  std::string status = "open";  // open, complete, stopped:WHY (disk, failed, interrupted), crashed
  std::string config_text, config_resolved, radar_cfg;
  std::string version, host, operator_name, notes;
  double window_s = 0;
  std::vector<std::pair<std::string, std::string>> meta;  // --meta, in the order given
};

}  // namespace echofuse::record
