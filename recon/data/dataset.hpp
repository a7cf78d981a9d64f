// SPDX-License-Identifier: MIT
// Run files as tables of numbers: one row per record, sensors side by side.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/depth_map.hpp"
#include "acquire/record/run_file.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/core/exit_code.hpp"
#include "recon/numbers/matrix.hpp"

namespace echofuse::recon {

// fused: both sensors, and of the radar what the run has, its antennas as well; fused_profile: its
// range profile alone, as if it had one antenna (the paper's).
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
  double radar_offset_m = 0;  // by which its profiles are still too long (subtract_range_offset)
};

// A sensor that a record lacks has zeros in its row; `has` tells. A run without the sensor at all,
// or of which it was not loaded, has an axis of count 0.
// What the sensors see of a room without people, on a Dataset's axes: a row of each of its tables.
struct EmptyRoom {
  std::vector<float> spd, radar, array;
  bool known() const { return !spd.empty() || !radar.empty(); }
};

struct Dataset {
  Axis spd_axis, radar_axis;  // the radar's after linearisation: "power" or "binned_power"
  // Of lags (lags.hpp); none of runs that differ in it, as old and new ones do.
  Axis array_axis;
  bool arrays_differ = false;
  record::MapGrid map;               // of the depth maps
  Matrix spd, radar, depth;          // photons | linear power | maps in metres, 0 = no return
  Matrix array;                      // of each bin its spatial lags
  std::vector<std::uint32_t> valid;  // bit 0 SPD, 1 radar, 2 depth
  std::vector<std::int64_t> index;   // the record's number in its run
  std::vector<HostTime> slot_end;
  std::vector<std::optional<record::Speckle>> speckle;  // of older runs not known
  std::vector<double> clicks_a_pulse;  // of the laser; 0: not known, or what they hide is put back
  std::vector<std::string> label;
  std::vector<Source> sources;
  EmptyRoom empty_room;    // where these records are; empty if that is not known
  std::uint32_t hash = 0;  // CRC-32C of the tables

  std::size_t size() const { return valid.size(); }
  bool has(std::size_t row, Sensor s) const { return SensorSet::from_bits(valid[row]).contains(s); }
  bool lacks_array(std::size_t row) const;       // although its run has one
  std::size_t source_of(std::size_t row) const;  // index into sources
  bool has_inputs(std::size_t row, Inputs inputs) const;
  // Why a model with these inputs cannot use the record; empty if it can. A sensor that says the
  // same in every bin is dead: it tells nothing, and no scaling makes it tell something.
  std::string fault_of(std::size_t row, Inputs inputs) const;
  // Rows that have the model's sensors and, if asked, a depth map to compare with.
  Rows usable(Inputs inputs, bool with_depth = true) const;
};

// Called with the number of a record that cannot be used and why.
using OnBadRecord = std::function<void(std::int64_t, const std::string&)>;

SensorSet sensors_of(Inputs inputs);

// Throws Error(failed) if the runs' tables, of 25 kB a record in a training with maps of 64 x 64,
// are more than the machine's memory holds.
void require_memory(const std::vector<std::string>& paths);

// Reads runs whose axes and map grids agree into one table, with true ranges. Throws Error(failed)
// that names the file and, for a bad record (wrong size, not a finite number), its number, unless
// on_bad takes it; and as require_memory.
Dataset load(const std::vector<std::string>& paths, const OnBadRecord& on_bad = {});
// The same with the radar's profiles as they were recorded: subtract_range_offset() then takes off
// what the calibration and the operator ask for in one interpolation.
Dataset load_recorded(const std::vector<std::string>& paths, const OnBadRecord& on_bad = {});

// A run by parts, as recorded: its records from number `first` on, at most `at_most` of them beside
// those that on_bad takes. Of the sensors that are not asked for, nothing is there. Leaves `hash`
// 0.
Dataset load_part(const record::RunReader& run, std::int64_t first, std::size_t at_most,
                  SensorSet sensors, const OnBadRecord& on_bad);

// Moves what the radar says, on the axis that the data have, to ranges shorter by this and by what
// their calibration still asks for.
void subtract_range_offset(Dataset& data, double offset_m);

// The rows of a data set as one of their own, which belong to no source.
Dataset part_of(const Dataset& data, const Rows& rows);

// The paper's range bins, 0 to 7 m, if the width is 0.5 m: quantity "binned_power".
Axis radar_bins(double width_m);

// Adds up the radar's power in wider bins. Point i of the recorded profile spreads evenly over
// [i - 1/2, i + 1/2] steps, so that no energy within the bins' span is lost or made; what lies
// below the first bin (half of point 0) belongs to it. A dead sensor's row stays one. Throws
// Error(failed) if the profile is coarser or shorter than the bins.
void rebin_radar(Dataset& data, const Axis& bins);

// Leaves the radar with one antenna.
void drop_array(Dataset& data);

// Whether values on this axis are values on the wanted one, the last of them left out if need be.
bool covers(const Axis& found, const Axis& wanted);

// Throws Error(failed) if any record has a depth map and the maps are not on this grid, whose it is
// says `whose`.
void require_map(const Dataset& data, const record::MapGrid& grid, const std::string& whose);

// Brings the tables onto the axes of a model: a radar axis with the same start and step but more
// bins is cropped; for a model with binned power the radar is rebinned. Throws Error(failed) if the
// axes that `inputs` needs differ otherwise.
void match_axes(Dataset& data, const Axis& spd, const Axis& radar, Inputs inputs);
// The same of the radar's antennas, which are dropped for a model that does not take them (an axis
// of count 0).
void match_array(Dataset& data, const Axis& array);

}  // namespace echofuse::recon
