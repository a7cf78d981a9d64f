// SPDX-License-Identifier: MIT
// One row of a run: the data of the three sensors in one slot.
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

// Coverage of the slot by one sensor. Times are times of measurement: device times converted by the
// clock fit; without a fit, times of receipt.
struct SensorSync {
  double offset_s = 0;              // mean time of the samples used, minus the slot's centre
  double span_s = 0;                // last minus first time of the samples used
  std::uint64_t used = 0;           // SPD: clicks in the histogram; radar, depth: frames
  std::uint64_t lost = 0;           // tags, radar frames, depth frames known to be lost
  std::string verdict = "missing";  // "ok", or why the sensor is not valid
};

// Fit of a device's clock to the host's clock, from the receive times of its samples.
struct ClockState {
  double offset_s = 0;        // host time minus device time, at the slot's centre
  double drift_ppm = 0;       // positive: the device's clock is fast
  double residual_s = 0;      // mean distance of the least delayed samples from the fit
  std::uint64_t samples = 0;  // number of samples in the fit
};

// Signal strength of each sensor; no value: unknown. Ranges are uncorrected.
struct Signal {
  std::optional<double> clicks_a_pulse;          // per laser pulse, even if only some starts are
                                                 // sent
  std::optional<double> spd_clicks, spd_peak_m;  // clicks above the background; highest bin
  std::optional<double> radar_snr_db, radar_peak_m;  // highest bin over the median bin; its range
  std::optional<double> depth_share;                 // pixels with a return / all pixels

  bool operator==(const Signal&) const = default;
};
// Limit of pile-up: above it the first photon of a pulse hides too many later ones.
inline constexpr double most_clicks_a_pulse = 0.05;

// Stored with every record, for audits.
struct SlotStatistics {
  std::uint64_t radar_frames = 0, depth_frames = 0;     // all frames of the slot
  std::optional<std::uint32_t> radar_last, depth_last;  // number of the last frame
  double closed_late_s = 0;                             // delay after the slot's end and grace
};

// positions of RadarTemperature on the chip
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
  SensorSet missing;  // sensors required by the run and missing in this record
  PerSensor<std::optional<ClockState>> clocks;  // no value: samples were assigned by time of
                                                // receipt
  SlotStatistics statistics;
  // Values of the slot's last radar frame that has them, without temperatures that the chip marks
  // as invalid.
  std::optional<RadarStats> radar_stats;
  std::optional<RadarTemperature> radar_temperature;

  bool has(Sensor s) const { return valid.contains(s); }
};

// Tags, radar frames and depth frames that arrived after their slot was closed, by slot number.
using LateCounts = std::map<std::int64_t, PerSensor<std::uint64_t>>;

struct CalibrationEntry {
  Sensor sensor{};
  std::string date_utc, method;
  double distance_m = 0, offset_m = 0, standard_error_m = 0;
  std::string model = {}, serial = {};  // identity of the device; not stored in a run

  bool operator==(const CalibrationEntry&) const = default;
};

// The row of the table run.
struct RunInfo {
  std::string uuid;                    // set by the writer
  std::string started_utc, ended_utc;  // ISO 8601
  std::string status = "open";  // open, complete, stopped:WHY (disk, failed, interrupted), crashed
  std::string config_text, config_resolved, radar_cfg;
  std::string version, host, operator_name, notes;
  double window_s = 0;
  std::vector<std::pair<std::string, std::string>> meta;  // --meta, in the given order
};

}  // namespace echofuse::record
