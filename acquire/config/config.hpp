// SPDX-License-Identifier: MIT
// The daemon's configuration: a TOML file, parsed strictly.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/calibration.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/detector.hpp"
#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/alerts.hpp"
#include "drivers/make_driver.hpp"
#include "drivers/radar/profile.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse {
class Settings;
}

namespace echofuse::acquire {

// Limits of SignalCheck; 0 disables a check.
struct SignalLimits {
  double weak_share = 0.1, spd_clicks = 1000, clicks_a_pulse = record::most_clicks_a_pulse;
  double radar_snr_db = 6, depth_share = 0.005, lossy_share = 0.8;
};
void bind_limits(Settings& settings, SignalLimits& limits);  // keys signal.*

// bind() in config.cpp documents the keys.
struct Config {
  double window_s = 3, connect_timeout_s = 10;
  std::string label, operator_name, run_folder;
  TdcConfig tdc;
  tdc::HistogramSettings histogram;
  double laser_rate_hz = 0;  // 0: unknown
  record::Detector detector;
  RadarConfig radar;
  double baseline_m = 0.5;  // from the detector to the left, to the centre of the radar's antennas
  DepthConfig depth;
  record::MapGrid map;
  SignalLimits signal;
  record::AlertLimits alert;
  std::vector<std::string> on_doubt;  // program and arguments; not in `resolved`, which is stored
  Calibration calibration;            // read from run.calibration
  record::Antennas antennas;     // antennas of the heat map, with calibration; empty: no heat map
  std::string calibration_path;  // that file, or its future path
  PerSensor<std::string> policy{"optional", "optional", "optional"};

  std::vector<std::string> unfinished;  // faults for `config check` and `doctor` only, with their
                                        // origin: the template's XXXXXXXX, no program of on_doubt
  std::string text;                     // contents of the file, verbatim
  std::string resolved;                 // every key with its value and meaning, as TOML
  std::string shown;                    // same, with the origin of each value

  SensorSet configured() const;  // sensors with an address
  SensorSet required() const;    // sensors required to start the run
  // Configured rates of starts, radar frames and camera frames per second; 0: unknown.
  PerSensor<double> nominal_hz() const;
};

// Reads the file, then applies `assignments` ("key=value"). The path of the radar cfg is relative
// to the file's folder. Throws Error(config) listing all faults, each with the origin of its key.
// Does not open devices, so a valid address may have no device. `with_calibration`: also reads the
// file of run.calibration; false for a command that overwrites it.
Config load_config(const std::string& path, const std::vector<std::string>& assignments = {},
                   bool with_calibration = true);

// Parses the radar's cfg. Throws like radar::parse_profile.
radar::RadarProfile parse_profile(const RadarConfig& radar);

struct ConfigPlace {
  std::string path;
  std::string name;  // for messages: "$ECHOFUSE_CONFIG", "./lab.toml"
};

// Places in search order: only $ECHOFUSE_CONFIG if it is set; otherwise ./lab.toml,
// $XDG_CONFIG_HOME/echofuse/lab.toml (default ~/.config), /etc/echofuse/lab.toml.
std::vector<ConfigPlace> config_places();

// Returns the first place with a file. Returns the file of $ECHOFUSE_CONFIG even if it is missing,
// because it was requested.
std::optional<ConfigPlace> find_config();

// Calls find_config(); throws Error(config) with all searched places if no file was found.
ConfigPlace require_config();

}  // namespace echofuse::acquire
