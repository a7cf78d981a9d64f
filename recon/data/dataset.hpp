// SPDX-License-Identifier: MIT
// Data set: the records of one or several runs as numeric tables. Each sensor has a table with one
// row per record.
#pragma once
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/response.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/core/zone.hpp"
#include "drivers/util/exit_code.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// Sensors that a model uses. fused: SPD and radar, including the radar's antenna samples if the run
// contains them. fused_profile: SPD and the range profile of the radar, without antenna samples, as
// in Lai et al. (2024).
enum class Inputs : std::uint8_t { fused, spd, radar, fused_profile };
inline const std::vector<std::string> inputs_names = {"fused", "spd", "radar", "fused-profile"};
inline const std::string& name_of(Inputs i) { return inputs_names[static_cast<std::size_t>(i)]; }
inline Inputs without_antennas(Inputs i) { return i == Inputs::fused ? Inputs::fused_profile : i; }
inline bool both_sensors(Inputs i) { return i == Inputs::fused || i == Inputs::fused_profile; }
Inputs inputs_of(const std::string& name);  // throws Error(usage) if the name is unknown

// One run of a Dataset; its records are the rows [first, first + count).
struct Source {
  std::string path, uuid;
  std::size_t first = 0, count = 0;
  // Calibration offset that has not yet been subtracted from the profiles, m (see
  // subtract_range_offset).
  double radar_offset_m = 0;
  // Radar response stored in the run file or, after a conversion, the response to which the run was
  // converted (response_conversion.hpp).
  record::RadarResponse radar_response = {};
  // Effect of converting the radar response: the old response width divided by the new one, and the
  // factor by which white noise was amplified.
  double times_wider = 1, noise_factor = 1;
  // range_error_m: standard error of the difference between the range offsets of SPD and radar, if
  // both are calibrated. baseline_m: distance between the sensors; 0 if it is not stored in the
  // run.
  std::optional<double> range_error_m = {};
  double baseline_m = 0;
};

// Sensor data of the room without people, on the axes of a Dataset; one row for each of its tables.
struct EmptyRoom {
  std::vector<float> spd, radar, array, zone_spd = {};
  // Message stating how many records were excluded from the mean; may be empty.
  std::string left_out = {};
  bool known() const { return !spd.empty() || !radar.empty(); }
};

struct DamagedRecord {
  std::string path;  // path of the run
  std::int64_t index = 0;
  std::string why;
};
std::string to_text(const DamagedRecord& damaged);  // returns "RUN: record 3: REASON"

// Reason to exclude a record: all bins of the SPD or radar have the same value.
inline constexpr const char* dead_record = "the same in every bin";
// Reason to exclude a record: it was used for training or validation of the model.
inline constexpr const char* trained_on_record = "trained on";
// Reason to exclude a record: an earlier record of the run has the same counts.
inline constexpr const char* twice_in_run = "twice in the run";

// Verdicts that exclude a record: doubtful ones, and "lossy". A model stores the exclusions of its
// training, and match() applies them to the records that it processes.
struct Exclusions {
  bool doubtful = true, lossy = false;
};

// Records of one or several runs as tables, one row per record. If a sensor is missing in a record,
// its row contains zeros (see has()). If a run does not have a sensor, or the sensor was not
// loaded, the sensor's axis has count 0.
struct Dataset {
  // The quantity of `radar_axis` is "power", or "binned_power" after rebinning. The receiver noise
  // has been subtracted.
  Axis spd_axis, radar_axis;
  // Axis of the spatial lags (lags.hpp); empty if the axes of the runs differ.
  Axis array_axis;
  bool arrays_differ = false;
  record::MapGrid map;  // grid of the depth maps
  // Number of photons per SPD bin, linear radar power per range bin, and depth maps in metres (0:
  // no return).
  Matrix spd, radar, depth;
  Matrix array;  // spatial lags per range bin
  Zones zones;   // empty for a single-pixel detector
  // Number of photons per bin of `spd_axis`, one zone after another; no columns if the detector has
  // a single pixel. `spd` contains the sum over the zones.
  Matrix zone_spd;
  // Bit mask of the sensors that have data in the record: bit 0 SPD, bit 1 radar, bit 2 depth
  // camera.
  std::vector<std::uint32_t> valid;
  // Kind of the verdict (quality flag) on each sensor. The vector is empty if the records have no
  // verdicts.
  std::vector<PerSensor<record::VerdictKind>> verdicts;
  Exclusions exclusions;
  // Hash that is used to find copies of records, computed from the SPD counts between the first and
  // the last nonzero bin, or from the radar values if the SPD is missing. 0: no hash, because the
  // record has too few clicks or is doubtful. The vector may be empty.
  std::vector<std::int64_t> content;
  std::vector<std::int64_t> index;  // index of the record in its run
  std::vector<HostTime> slot_end;
  // Number of clicks per laser pulse; 0 if it is unknown or pile-up has been corrected.
  std::vector<double> clicks_per_pulse;
  std::vector<std::string> label;
  std::vector<Source> sources;
  std::vector<DamagedRecord> damaged;  // unreadable records, which have no row
  EmptyRoom empty_room;                // data of the empty room, if known
  std::uint32_t hash = 0;              // CRC-32C of the tables

  std::size_t size() const { return valid.size(); }
  bool has(std::size_t row, Sensor s) const { return SensorSet::from_bits(valid[row]).contains(s); }
  // Returns true if the run has antenna samples but this record has none.
  bool lacks_array(std::size_t row) const;
  std::size_t source_of(std::size_t row) const;  // index into `sources`
  // Returns the width of the row's measured radar response divided by the width of the converted
  // response. Returns 1 if the response was not converted.
  double times_wider(std::size_t row) const;
  bool has_inputs(std::size_t row, Inputs inputs) const;
  // Returns why a model with these inputs cannot use the record; empty if it can. A sensor is dead
  // if all its bins have the same value.
  std::string fault_of(std::size_t row, Inputs inputs) const;
  // Returns true if the verdict excludes the data of a sensor: as an input, or the depth map as a
  // ground truth.
  bool excluded(std::size_t row, Sensor s) const;
  // Returns the verdict that makes a model with these inputs exclude a complete record, e.g.
  // "camera stands still" or "SPD weak"; empty if the record is not excluded. Verdicts on the
  // camera are ignored if `with_camera` is false.
  std::string doubt_of(std::size_t row, Inputs inputs, bool with_camera = true) const;
  // Returns true if the depth camera, or a sensor used by these inputs, lost samples in this
  // record.
  bool is_lossy(std::size_t row, Inputs inputs) const;
  // For each row, returns why a model with these inputs excludes it, or an empty string if the row
  // is used. Reasons: a sensor is missing, dead or doubtful, or the row is a copy of an earlier
  // record.
  std::vector<std::string> left_out(Inputs inputs) const;
  // Returns true if the row has a depth map and no camera verdict excludes it.
  bool sound_depth(std::size_t row) const;
  Rows usable(Inputs inputs) const;  // returns the rows that left_out() does not exclude
};

// Returns a summary such as "3 of 60 records left out: camera stands still 2, damaged 1"; empty if
// no record is left out.
std::string left_out_text(const std::map<std::string, std::size_t>& reasons, std::size_t all);

// Called for each unusable record, with the record's index and the reason.
using OnBadRecord = std::function<void(std::int64_t, const std::string&)>;

SensorSet sensors_of(Inputs inputs);

// Throws Error(failed) if the tables of the runs would not fit into the machine's memory. Training
// needs 25 kB per record if maps have 64 x 64 pixels.
void require_memory(const std::vector<std::string>& paths);

// Reads the runs into one Dataset that has the axes of the first run (see is_near()). Subtracts the
// calibrated range offsets. All runs must have the same map grid. Dataset::damaged lists records
// with a wrong size, values that are not finite, or more clicks than a time tagger can send. Throws
// Error(failed) with the file name if the fraction of damaged records exceeds `most_damaged`.
// Throws the same error if the memory is too small (require_memory), or if depths have the wrong
// unit (depth_check.hpp).
Dataset load(const std::vector<std::string>& paths);
// Reads runs like load(), but keeps the radar profiles as recorded and computes no hash.
// subtract_range_offset() can then subtract the calibration offset and the user's offset in one
// interpolation.
Dataset load_recorded(const std::vector<std::string>& paths);
inline constexpr double most_damaged = 0.1;

// Reads part of a run as recorded: at most `at_most` usable records, starting at record `first`.
// Calls `on_bad` for each unusable record. Tables of sensors that are not requested stay empty, and
// `hash` stays 0.
Dataset load_part(const record::RunReader& run, std::int64_t first, std::size_t at_most,
                  SensorSet sensors, const OnBadRecord& on_bad);

// Shifts the radar profiles and lags to shorter ranges, by `offset_m` plus the calibration offset
// that has not yet been subtracted (Source::radar_offset_m). Does not change the axis.
void subtract_range_offset(Dataset& data, double offset_m);

// Returns these rows as a separate Dataset, which has no sources.
Dataset part_of(const Dataset& data, const Rows& rows);

// Returns an axis of range bins that are `width_m` wide, from 0 to about 7 m. Its quantity is
// "binned_power". Lai et al. (2024) use a width of 0.5 m.
Axis radar_bins(double width_m);

// Sums the radar power into wider bins and removes the spatial lags. Point i of the recorded
// profile covers [i - 1/2, i + 1/2] steps, so that the energy is conserved. The part of point 0
// below range 0 is added to the first bin. The row of a dead sensor stays constant. Throws
// Error(failed) if the profile has wider steps than the bins, or ends before the last bin.
void rebin_radar(Dataset& data, const Axis& bins);

// Removes the spatial lags of the antennas but keeps the range profile.
void drop_array(Dataset& data);

// describe: returns an axis as text for messages. axis_error: returns the error for a wrong axis;
// `owner` names the run or model that has the expected axis.
std::string describe(const Axis& axis);
Error axis_error(const std::string& path, const Axis& found, const Axis& wanted,
                 const std::string& owner);

// Returns true if the axes are equal or both empty.
bool agree(const Axis& a, const Axis& b);
// Returns true if records on axis `found` can be interpolated to axis `wanted`. Quantity, unit and
// scale must be equal. `found` must not have fewer points than `wanted`, and the ends of the two
// axes may differ by at most one bin.
bool is_near(const Axis& found, const Axis& wanted);
// Resamples a row onto the axis `wanted` by linear interpolation; each bin has `values_a_bin`
// values. Beyond the ends of `found`, the values of its first or last bin are repeated.
std::vector<float> resampled(std::span<const float> row, const Axis& found, const Axis& wanted,
                             std::size_t values_a_bin);
// Returns true if `wanted` is identical to `found` or to the first part of `found`.
bool covers(const Axis& found, const Axis& wanted);

// Throws Error(failed) if the data contain a depth map on a grid other than `grid`; `owner` names
// the run or model that has the expected grid.
void require_map(const Dataset& data, const record::MapGrid& grid, const std::string& owner);

// Converts the tables to the axes of a model, for the sensors in `inputs`. A radar axis that has
// the same start and step but more bins is cropped. Any other axis is interpolated if is_near()
// returns true. The radar is rebinned if the model uses binned power. Throws Error(failed) if an
// axis does not match; `owner` names the model that has the expected axes.
void match_axes(Dataset& data, const Axis& spd, const Axis& radar, Inputs inputs,
                const std::string& owner = "the model's");
// Converts the spatial lags to the axis of a model, in the same way as match_axes(). Removes the
// lags if the model does not use antennas (`array` has count 0). Throws Error(failed) if the run
// has no lags or a different axis.
void match_array(Dataset& data, const Axis& array);

}  // namespace echofuse::recon
