// SPDX-License-Identifier: MIT
// Data set: the records of one or several runs as numeric tables. Each sensor has a table with one
// row per record.
#pragma once
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "acquire/record/run_reader.hpp"
#include "drivers/util/exit_code.hpp"
#include "recon/data/column.hpp"
#include "recon/data/exclusion.hpp"
#include "recon/data/response.hpp"

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
  RunResponse response = {};
  // Standard error of the difference between the range offsets of SPD and radar, if both are
  // calibrated.
  std::optional<double> calibration_error_m = {};
  record::RadarMounting mounting = {};

  // Standard deviation of the difference between radar range and SPD range: calibration error and
  // mounting tolerance. A run without a calibration has only the tolerance.
  double range_error_m() const {
    return std::hypot(calibration_error_m.value_or(0), mounting.tolerance_m);
  }
};

struct DamagedRecord {
  std::string path;
  std::int64_t index = 0;
  std::string why;
};
std::string to_text(const DamagedRecord& damaged);  // returns "RUN: record 3: REASON"

// Facts about a record that are not in its columns.
struct RecordInfo {
  SensorSet valid;                            // sensors that have data
  PerSensor<record::VerdictKind> verdicts{};  // ok if the record has no verdicts
  std::int64_t content = 0;                   // fingerprint (recon/data/copies.hpp); 0 if unknown
  std::int64_t index = 0;
  HostTime slot_end{};
  // Number of clicks per laser pulse; 0 if it is unknown or pile-up has been corrected.
  double clicks_per_pulse = 0;
  std::string label{};
};

// Records of one or several runs as columns, one row per record.
struct Dataset {
  // Use the functions spd(), radar(), depth() and array().
  std::vector<Column> columns{{{}, Sensor::spd, Noise::counts},
                              {{}, Sensor::radar, Noise::power},
                              {{}, Sensor::depth, Noise::none},
                              {{}, Sensor::radar, Noise::lags}};
  record::MapGrid map;  // grid of the depth maps
  std::vector<RecordInfo> records;
  Exclusions exclusions;
  std::vector<Source> sources;
  std::vector<DamagedRecord> damaged;  // unreadable records, which have no row
  std::uint32_t hash = 0;              // CRC-32C of the tables

  // Number of photons per bin of each zone.
  Column& spd() { return columns[0]; }
  const Column& spd() const { return columns[0]; }
  // Linear radar power per range bin, without the receiver noise. The quantity of the axis is
  // "power", or "binned_power" after rebinning.
  Column& radar() { return columns[1]; }
  const Column& radar() const { return columns[1]; }
  // Depth maps in metres (0: no return).
  Column& depth() { return columns[2]; }
  const Column& depth() const { return columns[2]; }
  // Spatial lags per range bin (lags.hpp).
  Column& array() { return columns[3]; }
  const Column& array() const { return columns[3]; }

  std::size_t size() const { return records.size(); }
  bool has(std::size_t row, Sensor s) const { return records[row].valid.contains(s); }
  // Returns the path of the first run, for messages.
  std::string path() const { return sources.empty() ? "run" : sources.front().path; }
  std::size_t source_of(std::size_t row) const;  // index into `sources`
};

// Returns the number of photons per SPD bin of a row, summed over the zones.
std::vector<float> counts_of(const Dataset& data, std::size_t row);
// Returns the profile of a row without the range bins that may contain transmitter leakage, or the
// whole profile if fewer than three bins would remain.
std::span<const float> beyond_leakage(const Column& profiles, std::size_t row);
// Returns the width of the row's measured radar response divided by the width of the converted
// response. Returns 1 if the response was not converted.
double times_wider(const Dataset& data, std::size_t row);

// Called for each unusable record, with the record's index and the reason.
using OnBadRecord = std::function<void(std::int64_t, const std::string&)>;

SensorSet sensors_of(Inputs inputs);
// Returns the sensors that the runs of a data set have.
Inputs inputs_of(const Dataset& data);

// Throws Error(failed) if the tables of the runs would not fit into the machine's memory. Training
// needs 25 kB per record if maps have 64 x 64 pixels.
void require_memory(const std::vector<std::string>& paths);

// Reads the runs into one Dataset that has the axes of the first run (see is_near()). Subtracts the
// calibrated range offsets. All runs must have the same map grid. Dataset::damaged lists records
// with a wrong size, values that are not finite, or more clicks than a time tagger can send. Throws
// Error(failed) with the file name if the fraction of damaged records exceeds `max_damaged`.
// Throws the same error if the memory is too small (require_memory), or if depths have the wrong
// unit (depth_check.hpp).
Dataset load(const std::vector<std::string>& paths);
// Reads runs like load(), but keeps the radar profiles as recorded and computes no hash.
// subtract_range_offset() can then subtract the calibration offset and the user's offset in one
// interpolation.
Dataset load_recorded(const std::vector<std::string>& paths);
inline constexpr double max_damaged = 0.1;
// Returns the CRC-32C of the columns (Dataset::hash).
std::uint32_t crc32c_of(const Dataset& data);

// Reads part of a run as recorded: at most `at_most` usable records, starting at record `first`.
// Calls `on_bad` for each unusable record. Tables of sensors that are not requested stay empty, and
// `hash` stays 0.
Dataset load_part(const record::RunReader& run, std::int64_t first, std::size_t at_most,
                  SensorSet sensors, const OnBadRecord& on_bad);

// Converts one record of a run, without the tables of sensors that are not in `sensors`. Returns no
// records and sets `fault` if the record is unusable.
Dataset load_record(const record::RunHead& run, record::FusedRecord record, SensorSet sensors,
                    std::string& fault);

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

// Returns the error for a wrong axis; `owner` names the run or model that has the expected axis.
Error axis_error(const std::string& path, const ColumnAxis& found, const ColumnAxis& expected,
                 const std::string& owner);

// Returns true if the axes are equal or both empty. The zones must have the same directions in the
// same order.
bool agree(const ColumnAxis& a, const ColumnAxis& b);
// Returns true if records on axis `found` can be interpolated to axis `expected`. Quantity, unit,
// scale and zones must be equal. `found` must not have fewer points than `expected`, and the ends
// of the two axes may differ by at most one bin.
bool is_near(const ColumnAxis& found, const ColumnAxis& expected);
// Resamples a row onto the axis `expected` by linear interpolation. Beyond the ends of `found`, the
// values of its first or last bin are repeated. Crops the row if `expected` is the first part of
// `found`.
std::vector<float> resampled(std::span<const float> row, const ColumnAxis& found,
                             const ColumnAxis& expected);

// Throws Error(failed) if the data contain a depth map on a grid other than `grid`; `owner` names
// the run or model that has the expected grid.
void require_map(const Dataset& data, const record::MapGrid& grid, const std::string& owner);

// Converts the columns of the sensors in `inputs` to the axes of a model. A column that has the
// same start and step but more bins is cropped. Any other column is interpolated if is_near()
// returns true. Zones are summed if the model expects a single pixel. The radar is rebinned if the
// model uses binned power. Removes the spatial lags if the model does not use antennas. Throws
// Error(failed) if an axis does not match; `owner` names the model that has the expected axes.
void match_axes(Dataset& data, const Layout& expected, Inputs inputs,
                const std::string& owner = "the model's");

}  // namespace echofuse::recon
