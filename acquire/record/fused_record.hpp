// SPDX-License-Identifier: MIT
// Record of a run: the data of the three sensors in one slot.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/measurement/verdict.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/core/tag_counts.hpp"

namespace echofuse::record {

// Samples of one sensor in a slot. Times are device times converted to host time by the clock fit,
// or arrival times if the fit is missing.
struct SensorSync {
  double offset_s = 0;  // mean time of the used samples minus the centre of the slot
  double span_s = 0;    // time from the first to the last used sample
  // SPD: number of clicks in the histogram; radar and depth: number of frames.
  std::uint64_t used = 0;
  // Number of tags, histograms or frames that are known to be lost. Tags of lost blocks are
  // estimated from the mean size of a block.
  std::uint64_t lost = 0;
  Verdict verdict;
  // Number of samples in the slot, in the unit of `lost`; not stored.
  std::uint64_t arrived = 0;

  bool doubtful() const { return verdict.row().doubtful; }
  std::string word() const { return verdict.word(); }
  std::string text() const { return verdict.text(); }
  // Returns the reason why a configured device delivered nothing usable; empty if unknown.
  std::string cause() const {
    const bool known =
        verdict.kind != VerdictKind::missing && verdict.kind != VerdictKind::not_configured;
    return known ? verdict.text() : "";
  }
};

// Fit of the device clock to the host clock, based on the arrival times of the samples.
struct ClockState {
  double offset_s = 0;    // host time minus device time, at the slot's centre
  double drift_ppm = 0;   // positive if the device clock is fast
  double residual_s = 0;  // mean deviation of the least delayed samples from the fit
  std::uint64_t samples = 0;
};

// Signal strength of each sensor; a missing value is unknown. Range offsets are not subtracted.
struct Signal {
  // Number of clicks per laser pulse. It is correct even if the time tagger sends only some of the
  // start tags.
  std::optional<double> clicks_per_pulse;
  // Number of clicks above the background, and range of the highest bin.
  std::optional<double> spd_clicks, spd_peak_m;
  // Ratio of the peak to the median of the range profile, and range of the peak.
  std::optional<double> radar_snr_db, radar_peak_m;
  std::optional<double> depth_share;  // fraction of depth pixels that have a return

  bool operator==(const Signal&) const = default;
};
// Pile-up limit. Above this number of clicks per laser pulse, the first photon of a pulse hides too
// many later photons.
inline constexpr double max_clicks_per_pulse = 0.05;

// Statistics of a slot, stored with its record so that losses and delays can be checked later.
struct SlotStatistics {
  std::uint64_t radar_frames = 0, depth_frames = 0;
  std::optional<std::uint32_t> radar_last, depth_last;  // frame number of the last frame
  double closed_late_s = 0;  // time from the end of the grace period to the closing of the slot
};

// Positions of the temperature sensors on the radar chip, in the order of RadarTemperature.
inline constexpr const char* temperature_places[] = {"rx0", "rx1", "rx2", "rx3",  "tx0",
                                                     "tx1", "tx2", "pm",  "dig0", "dig1"};

// Largest allowed index of a record, chosen so that index + 1 cannot overflow.
inline constexpr std::int64_t max_index = std::int64_t{1} << 53;

struct FusedRecord {
  std::int64_t index = 0;
  HostTime slot_start{}, slot_end{};
  UtcTime slot_utc{};  // UTC at the start of the slot
  SensorSet valid;
  std::string label;
  std::vector<std::uint32_t> spd;  // counts per bin; empty if the sensor is missing
  std::vector<float> radar;        // range profile, in the unit of the run's radar axis
  // Statistics of the virtual antennas (radar_array.hpp) over `array_frames` frames; empty if the
  // radar sends no antenna data.
  std::vector<float> array;
  std::uint64_t array_frames = 0;
  std::vector<std::uint16_t> depth_mm;  // depth z, row-major on the run's depth axes; 0: no return
  TagCounts spd_counts;
  PerSensor<SensorSync> sync;
  Signal signal;
  SensorSet missing;  // required sensors that are missing in this record
  // Fits of the device clocks. If a sensor has no fit, its samples were assigned to slots by their
  // arrival times.
  PerSensor<std::optional<ClockState>> clocks;
  SlotStatistics statistics;
  // Values from the last radar frame of the slot that contains such values. Temperatures that the
  // chip marks as invalid are omitted.
  std::optional<RadarStats> radar_stats;
  std::optional<RadarTemperature> radar_temperature;

  bool has(Sensor s) const { return valid.contains(s); }
  // Returns "ok", the word of a doubtful verdict, or "no data".
  std::string state(Sensor s) const { return state_of(has(s), sync[s].verdict); }
  // Returns the number of clicks per laser pulse. Imported runs do not store it, so it is computed
  // from the counts. Returns 0 (unknown) if there are at least 0.95 clicks per start signal,
  // because the time tagger has then filtered out the start signals without a click.
  double clicks_per_pulse() const {
    constexpr double filtered = 0.95;
    if (signal.clicks_per_pulse) return *signal.clicks_per_pulse;
    const auto clicks = static_cast<double>(spd_counts.in_range + spd_counts.out_of_range);
    const auto starts = static_cast<double>(spd_counts.starts);
    return clicks < filtered * starts ? clicks / starts : 0;
  }
  void accept(Sensor s) { valid.insert(s), sync[s].verdict = ok_verdict; }
};

// Numbers of tags, radar frames and depth frames that arrived after their slot was closed, by slot
// number.
using LateCounts = std::map<std::int64_t, PerSensor<std::uint64_t>>;

struct CalibrationEntry {
  Sensor sensor{};
  std::string date_utc, method;
  double distance_m = 0, offset_m = 0, standard_error_m = 0;
  std::string model = {}, serial = {};  // identity of the device; not stored in a run

  bool operator==(const CalibrationEntry&) const = default;
};

struct CounterRow {
  std::string source, name;  // source: a sensor or "run"
  std::uint64_t value = 0;
};

// Content of the table `run`, which has one row.
struct RunInfo {
  std::string uuid;                    // created by the writer if empty
  std::string started_utc, ended_utc;  // UTC in ISO 8601 format
  std::string status = "open";  // open, complete, stopped:WHY (disk, failed, interrupted), crashed
  std::string config_text, config_resolved, radar_cfg;
  std::string version, host, operator_name, notes;
  double window_s = 0;
  std::vector<std::pair<std::string, std::string>> meta;  // key-value pairs from --meta, in order
};

}  // namespace echofuse::record
