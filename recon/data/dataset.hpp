// SPDX-License-Identifier: MIT
// A data set holds run files as tables of numbers: one row per record, sensors side by side.
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
#include "drivers/program/exit_code.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// `fused` takes both sensors, and all that the run has of the radar, its antennas as well.
// `fused_profile` takes the radar's range profile alone, as if it had one antenna (the paper's).
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
  double radar_offset_m = 0;  // its profiles are still too long by this (subtract_range_offset)
  record::RadarResponse radar_response = {};  // as stated, or brought to (data/response.hpp)
  // Effect of that step: width of the stated response over the new one, and factor of white noise.
  double times_wider = 1, noise_factor = 1;
  // Standard error of the difference of both sensors' offsets, if the run states a calibration of
  // both. The baseline is 0 if it is not stated.
  std::optional<double> range_error_m = {};
  double baseline_m = 0;
};

// EmptyRoom holds what the sensors see of a room without people, on a Dataset's axes: one row for
// each of its tables.
struct EmptyRoom {
  std::vector<float> spd, radar, array, zone_spd = {};
  std::string left_out = {};  // text that counts the records left out of the mean, or empty
  bool known() const { return !spd.empty() || !radar.empty(); }
};

struct DamagedRecord {
  std::string path;  // its run
  std::int64_t index = 0;
  std::string why;
};
std::string to_text(const DamagedRecord& damaged);  // "RUN: record 3: REASON"

// Reason of a record whose detector or radar has one value in every bin.
inline constexpr const char* dead_record = "the same in every bin";
// Reason of a record that trained or validated a model.
inline constexpr const char* trained_on_record = "trained on";
// Reason of a record whose counts an earlier record of the run has.
inline constexpr const char* twice_in_run = "twice in the run";

// Records as tables. A sensor that a record lacks has zeros in its row; `has` tells. A sensor that
// the run lacks, or that was not loaded, has an axis of count 0.
struct Dataset {
  Axis spd_axis, radar_axis;  // the radar's after linearisation: "power" or "binned_power"
  // The axis is that of the lags (lags.hpp). It is empty if the runs differ in it, as old and new
  // ones do.
  Axis array_axis;
  bool arrays_differ = false;
  record::MapGrid map;       // grid of the depth maps
  Matrix spd, radar, depth;  // photons | linear power | maps in metres, 0 = no return
  Matrix array;              // the spatial lags of each bin
  Zones zones;               // empty for a single pixel
  // Photons of each zone on spd_axis, zone after zone; no columns for a single pixel. `spd` is
  // their sum.
  Matrix zone_spd;
  std::vector<std::uint32_t> valid;  // bit 0 SPD, 1 radar, 2 depth
  // Verdicts of valid sensors without their figures; "" if ok. No entries: nothing is doubted.
  std::vector<PerSensor<std::string>> doubt;
  bool leave_lossy = false;  // true: the verdict "lossy" is a doubt
  // Hash of the detector's counts between its empty bins at both ends, by which copies are found;
  // without a detector that of the radar. 0 or no entries: too few clicks, or a doubt about them.
  std::vector<std::int64_t> content;
  std::vector<std::int64_t> index;  // the record's number in its run
  std::vector<HostTime> slot_end;
  std::vector<double> clicks_a_pulse;  // 0: not known, or pile-up is corrected
  std::vector<std::string> label;
  std::vector<Source> sources;
  std::vector<DamagedRecord> damaged;  // cannot be read, and have no row
  EmptyRoom empty_room;                // the room of these records; empty if not known
  std::uint32_t hash = 0;              // CRC-32C of the tables

  std::size_t size() const { return valid.size(); }
  bool has(std::size_t row, Sensor s) const { return SensorSet::from_bits(valid[row]).contains(s); }
  bool lacks_array(std::size_t row) const;  // true if the run has an array and the record does not
  std::size_t source_of(std::size_t row) const;  // index into sources
  // Width of the row's response as measured over its response here; 1 if it is as measured.
  double times_wider(std::size_t row) const;
  bool has_inputs(std::size_t row, Inputs inputs) const;
  // Reason why a model with these inputs cannot use the record; empty if it can. A sensor with the
  // same value in every bin is dead.
  std::string fault_of(std::size_t row, Inputs inputs) const;
  bool is_doubt(const std::string& kind) const;
  // Returns why the record is no example for a model with these inputs although it has all sensors,
  // as "camera frozen" or "SPD weak"; empty if it is one. A sensor that sees nobody ("no peak") is
  // no doubt; any other verdict of the depth is, unless the camera is not asked for.
  std::string doubt_of(std::size_t row, Inputs inputs, bool with_camera = true) const;
  // True if one of these sensors, or the camera, lost samples.
  bool is_lossy(std::size_t row, Inputs inputs) const;
  // Returns why each row is no example for a model with these inputs; empty if it is one. Reasons:
  // a sensor missing, dead or doubtful; a copy of an earlier record.
  std::vector<std::string> left_out(Inputs inputs) const;
  bool sound_depth(std::size_t row) const;  // true if it has a depth map without a doubt
  Rows usable(Inputs inputs) const;         // rows that are examples
};

// Returns "3 of 60 records left out: camera frozen 2, damaged 1", or nothing without reasons.
std::string left_out_text(const std::map<std::string, std::size_t>& reasons, std::size_t all);

// Called with the number of a record that cannot be used, and with the reason.
using OnBadRecord = std::function<void(std::int64_t, const std::string&)>;

SensorSet sensors_of(Inputs inputs);

// Throws Error(failed) if the runs' tables need more than the machine's memory. A training with
// maps of 64 x 64 takes 25 kB a record.
void require_memory(const std::vector<std::string>& paths);

// Reads runs into one table, with true ranges, on the axes of the first one (is_near). Their map
// grids agree. Damaged records (wrong size, not a finite number, more clicks than a tagger gives)
// are listed. Throws Error(failed) that names the file, or the first damaged record if those are
// more than most_damaged of all. Throws as require_memory, and for depths in another unit
// (depths_seen.hpp).
Dataset load(const std::vector<std::string>& paths);
// Loads with the radar's profiles as recorded. subtract_range_offset() then subtracts the offsets
// of calibration and operator in one interpolation.
Dataset load_recorded(const std::vector<std::string>& paths);
inline constexpr double most_damaged = 0.1;

// Reads part of a run, as recorded: records from number `first` on, at most `at_most` usable ones;
// on_bad gets the others. Sensors that are not asked for stay empty; `hash` stays 0.
Dataset load_part(const record::RunReader& run, std::int64_t first, std::size_t at_most,
                  SensorSet sensors, const OnBadRecord& on_bad);

// Moves the radar's values, on the axis that the data have, to ranges shorter by this offset and by
// what their calibration still asks for.
void subtract_range_offset(Dataset& data, double offset_m);

// Returns the rows of a data set as a data set of their own; it belongs to no source.
Dataset part_of(const Dataset& data, const Rows& rows);

// Range bins of this width from 0 on, up to 7 m at 0.5 m, as in the paper. The quantity is
// "binned_power".
Axis radar_bins(double width_m);

// Adds up the radar's power in wider bins. Point i of the recorded profile spreads evenly over [i -
// 1/2, i + 1/2] steps, so that no energy within the bins' span is lost or made. Power below the
// first bin (half of point 0) belongs to that bin. A dead sensor's row stays dead. Throws
// Error(failed) if the profile is coarser or shorter than the bins.
void rebin_radar(Dataset& data, const Axis& bins);

// Removes the antennas' samples; the range profile stays.
void drop_array(Dataset& data);

// Text of an axis in messages, and the refusal of one that does not fit; `whose` names the owner of
// the wanted one.
std::string describe(const Axis& axis);
Error axis_error(const std::string& path, const Axis& found, const Axis& wanted,
                 const std::string& whose);

// True if both axes are the same, or both are empty.
bool agree(const Axis& a, const Axis& b);
// The rule by which records of one axis serve on another, everywhere: it lies nowhere farther than
// a bin from the wanted one, and its last values may be left out. Values are then interpolated.
bool is_near(const Axis& found, const Axis& wanted);
// Returns a row, of so many values a bin, at the places of the wanted axis, by lines between the
// bins. Beyond the ends the last bin counts.
std::vector<float> resampled(std::span<const float> row, const Axis& found, const Axis& wanted,
                             std::size_t values_a_bin);
// True if values on this axis are values on the wanted one, perhaps without its last ones.
bool covers(const Axis& found, const Axis& wanted);

// Throws Error(failed) if any record has a depth map and the maps are not on this grid; `whose`
// names the owner of the grid.
void require_map(const Dataset& data, const record::MapGrid& grid, const std::string& whose);

// Brings the tables onto the axes of a model. A radar axis with the same start and step but more
// bins is cropped; values on an axis within a bin of the model's are interpolated. For a model with
// binned power the radar is rebinned. Throws Error(failed) if the axes that `inputs` needs differ
// otherwise; `whose` names the owner of the wanted ones.
void match_axes(Dataset& data, const Axis& spd, const Axis& radar, Inputs inputs,
                const std::string& whose = "the model's");
// Brings the antennas' axis onto the model's, as match_axes. Count 0 (a model without antennas)
// drops them. Throws Error(failed).
void match_array(Dataset& data, const Axis& array);

}  // namespace echofuse::recon
