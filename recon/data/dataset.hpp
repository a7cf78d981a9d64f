// SPDX-License-Identifier: MIT
// Data set: run files as numeric tables, one row per record, sensors as separate tables.
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

// fused: both sensors, including the radar's antennas if the run has them. fused_profile: the
// radar's range profile only, as with a single antenna (as in the paper).
enum class Inputs : std::uint8_t { fused, spd, radar, fused_profile };
inline const std::vector<std::string> inputs_names = {"fused", "spd", "radar", "fused-profile"};
inline const std::string& name_of(Inputs i) { return inputs_names[static_cast<std::size_t>(i)]; }
inline Inputs without_antennas(Inputs i) { return i == Inputs::fused ? Inputs::fused_profile : i; }
inline bool both_sensors(Inputs i) { return i == Inputs::fused || i == Inputs::fused_profile; }
Inputs inputs_of(const std::string& name);  // throws Error(usage)

// One run within a Dataset: rows [first, first + count).
struct Source {
  std::string path, uuid;
  std::size_t first = 0, count = 0;
  double radar_offset_m = 0;  // offset not yet subtracted from its profiles (subtract_range_offset)
  record::RadarResponse radar_response = {};  // as stated, or converted (response_conversion.hpp)
  // Effect of the conversion: width of the stated response over the new one, and gain of white
  // noise.
  double times_wider = 1, noise_factor = 1;
  // Standard error of the difference of both sensors' offsets, if the run has a calibration of
  // both. baseline_m is 0 if not stated.
  std::optional<double> range_error_m = {};
  double baseline_m = 0;
};

// Sensor data of the room without people, on a Dataset's axes: one row of each table.
struct EmptyRoom {
  std::vector<float> spd, radar, array, zone_spd = {};
  std::string left_out = {};  // number of records left out of the mean, as text; may be empty
  bool known() const { return !spd.empty() || !radar.empty(); }
};

struct DamagedRecord {
  std::string path;  // path of the run
  std::int64_t index = 0;
  std::string why;
};
std::string to_text(const DamagedRecord& damaged);  // "RUN: record 3: REASON"

// Reason: all bins of the detector or radar have the same value.
inline constexpr const char* dead_record = "the same in every bin";
// Reason: used for training or validation of the model.
inline constexpr const char* trained_on_record = "trained on";
// Reason: an earlier record of the run has the same counts.
inline constexpr const char* twice_in_run = "twice in the run";

// Records as tables. The row of a missing sensor contains zeros; see has(). A sensor that the run
// lacks, or that was not loaded, has an axis with count 0.
struct Dataset {
  Axis spd_axis, radar_axis;  // radar_axis after linearisation: "power" or "binned_power"
  // Axis of the lags (lags.hpp). Empty if the runs have different ones, e.g. old and new runs.
  Axis array_axis;
  bool arrays_differ = false;
  record::MapGrid map;       // grid of the depth maps
  Matrix spd, radar, depth;  // photons | linear power | maps in metres, 0 = no return
  Matrix array;              // spatial lags per bin
  Zones zones;               // empty for a single pixel
  // Photons of each zone on spd_axis, zone by zone; no columns for a single pixel. `spd` is their
  // sum.
  Matrix zone_spd;
  std::vector<std::uint32_t> valid;  // bit 0 SPD, 1 radar, 2 depth
  // Verdicts of valid sensors, without their figures; "" if ok. Empty: no verdicts.
  std::vector<PerSensor<std::string>> doubt;
  bool leave_lossy = false;  // true: the verdict "lossy" excludes a record
  // Hash of the detector's counts between the first and last nonzero bin, to find copies; without a
  // detector, of the radar's values. 0 or no entries: too few clicks, or a doubtful record.
  std::vector<std::int64_t> content;
  std::vector<std::int64_t> index;  // number of the record in its run
  std::vector<HostTime> slot_end;
  std::vector<double> clicks_a_pulse;  // 0: unknown, or pile-up is already corrected
  std::vector<std::string> label;
  std::vector<Source> sources;
  std::vector<DamagedRecord> damaged;  // unreadable; without a row
  EmptyRoom empty_room;                // empty room of these records; may be unknown
  std::uint32_t hash = 0;              // CRC-32C of the tables

  std::size_t size() const { return valid.size(); }
  bool has(std::size_t row, Sensor s) const { return SensorSet::from_bits(valid[row]).contains(s); }
  bool lacks_array(std::size_t row) const;  // true if the run has antenna samples and the record
                                            // has none
  std::size_t source_of(std::size_t row) const;  // index into `sources`
  // Width of the row's measured response over its current one; 1 if not converted.
  double times_wider(std::size_t row) const;
  bool has_inputs(std::size_t row, Inputs inputs) const;
  // Returns why a model with these inputs cannot use the record, or an empty text. A sensor with
  // equal values in all bins is dead.
  std::string fault_of(std::size_t row, Inputs inputs) const;
  bool is_doubt(const std::string& kind) const;
  // Returns why a complete record is excluded for a model with these inputs, e.g. "camera frozen"
  // or "SPD weak", or an empty text. "no peak" of a sensor does not exclude a record. Any other
  // verdict of the camera does, unless with_camera is false.
  std::string doubt_of(std::size_t row, Inputs inputs, bool with_camera = true) const;
  // Returns true if one of these sensors, or the camera, lost samples.
  bool is_lossy(std::size_t row, Inputs inputs) const;
  // Returns why each row is excluded for a model with these inputs; empty if it is used. Reasons: a
  // sensor missing, dead or doubtful; a copy of an earlier record.
  std::vector<std::string> left_out(Inputs inputs) const;
  bool sound_depth(std::size_t row) const;  // true if it has a depth map without an excluding
                                            // verdict
  Rows usable(Inputs inputs) const;         // rows without a reason in left_out()
};

// Returns "3 of 60 records left out: camera frozen 2, damaged 1", or nothing without reasons.
std::string left_out_text(const std::map<std::string, std::size_t>& reasons, std::size_t all);

// Called with the number of each unusable record and the reason.
using OnBadRecord = std::function<void(std::int64_t, const std::string&)>;

SensorSet sensors_of(Inputs inputs);

// Throws Error(failed) if the runs' tables exceed the machine's memory. Training with maps of 64 x
// 64 needs 25 kB per record.
void require_memory(const std::vector<std::string>& paths);

// Reads runs into one table, at true ranges, on the axes of the first run (see is_near). All runs
// must have the same map grid. Lists damaged records (wrong size, not finite, more clicks than a
// tagger can send). Throws Error(failed) with the file name, or with the first damaged record if
// more than most_damaged of all are damaged. Also throws like require_memory(), and for depths in
// another unit (depth_check.hpp).
Dataset load(const std::vector<std::string>& paths);
// Loads the radar's profiles as recorded. Then subtract_range_offset() subtracts the offsets of
// calibration and user in one interpolation.
Dataset load_recorded(const std::vector<std::string>& paths);
inline constexpr double most_damaged = 0.1;

// Reads recorded values of a part of a run: from record `first` on, at most `at_most` usable
// records; on_bad receives the others. Tables of sensors not requested stay empty; `hash` stays 0.
Dataset load_part(const record::RunReader& run, std::int64_t first, std::size_t at_most,
                  SensorSet sensors, const OnBadRecord& on_bad);

// Shifts the radar's values to shorter ranges by this offset plus the pending offset of the
// calibration (Source::radar_offset_m). The axis is unchanged.
void subtract_range_offset(Dataset& data, double offset_m);

// Returns these rows as a separate data set without sources.
Dataset part_of(const Dataset& data, const Rows& rows);

// Range bins of this width from 0 to about 7 m (paper: 0.5 m). Quantity: "binned_power".
Axis radar_bins(double width_m);

// Sums the radar's power in wider bins. Point i of the recorded profile covers [i - 1/2, i + 1/2]
// steps, so that energy within the bins is conserved. Power below the first bin (half of point 0)
// is added to that bin. A dead sensor's row stays dead. Throws Error(failed) if the profile is
// coarser or shorter than the bins.
void rebin_radar(Dataset& data, const Axis& bins);

// Removes the antenna samples; keeps the range profile.
void drop_array(Dataset& data);

// describe: text of an axis for messages. axis_error: error for a wrong axis; `owner` names the
// owner of the expected one.
std::string describe(const Axis& axis);
Error axis_error(const std::string& path, const Axis& found, const Axis& wanted,
                 const std::string& owner);

// Returns true if the axes are equal or both empty.
bool agree(const Axis& a, const Axis& b);
// Returns true if records of axis `found` can be interpolated to `wanted`: no point is more than a
// bin from the wanted axis, and only its last values may be missing. The rule for all programs.
bool is_near(const Axis& found, const Axis& wanted);
// Interpolates a row, with this number of values per bin, linearly to the wanted axis. Beyond the
// ends it repeats the last bin.
std::vector<float> resampled(std::span<const float> row, const Axis& found, const Axis& wanted,
                             std::size_t values_a_bin);
// Returns true if `wanted` equals `found` or its beginning.
bool covers(const Axis& found, const Axis& wanted);

// Throws Error(failed) if a record has a depth map and the maps have another grid; `owner` names
// the owner of the expected grid.
void require_map(const Dataset& data, const record::MapGrid& grid, const std::string& owner);

// Converts the tables to the axes of a model. A radar axis with equal start and step but more bins
// is cropped; values within a bin of the model's axis are interpolated. For a model of binned power
// the radar is rebinned. Throws Error(failed) if axes needed for `inputs` differ otherwise; `owner`
// names the owner of the expected ones.
void match_axes(Dataset& data, const Axis& spd, const Axis& radar, Inputs inputs,
                const std::string& owner = "the model's");
// Converts the antennas' axis to the model's, like match_axes(). Count 0 (a model without antennas)
// removes them. Throws Error(failed).
void match_array(Dataset& data, const Axis& array);

}  // namespace echofuse::recon
