// SPDX-License-Identifier: MIT
// The daemon's configuration: a TOML file, read strictly.
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

// Limits of SignalCheck; 0 switches one off.
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
  double laser_rate_hz = 0;  // 0: not known
  record::Detector detector;
  RadarConfig radar;
  double baseline_m = 0.5;  // from the detector to the left, to the middle of the radar's antennas
  DepthConfig depth;
  record::MapGrid map;
  SignalLimits signal;
  record::AlertLimits alert;
  std::vector<std::string> on_doubt;  // program and arguments; not in `resolved`, which is stored
  Calibration calibration;            // read from run.calibration
  record::Antennas antennas;          // antennas of the heat map, calibrated; empty: none sent
  std::string calibration_path;       // that file, or where one would stand
  PerSensor<std::string> policy{"optional", "optional", "optional"};

  std::vector<std::string> unfinished;  // keys with the template's XXXXXXXX left, and their place
  std::string text;                     // contents of the file, verbatim
  std::string resolved;                 // every key with its value and meaning, as TOML
  std::string shown;                    // the same, with the origin of each value

  SensorSet configured() const;  // the sensors that have an address
  SensorSet required() const;    // those that the run does not start without
  // Starts, radar frames and camera frames a second as configured; 0: not known.
  PerSensor<double> nominal_hz() const;
};

// Reads the file, then applies `assignments` ("key=value"). A radar cfg named in it is read
// relative to the file's folder. Throws Error(config) listing all faults, each with the place of
// its key. Nothing is opened: that an address can be does not mean that a device is there. Without
// `with_calibration` the file of run.calibration is not read: it is about to be written.
Config load_config(const std::string& path, const std::vector<std::string>& assignments = {},
                   bool with_calibration = true);

// Parses the radar's cfg. Throws as radar::parse_profile.
radar::RadarProfile parse_profile(const RadarConfig& radar);

struct ConfigPlace {
  std::string path;
  std::string name;  // as a text calls it: "$ECHOFUSE_CONFIG", "./lab.toml"
};

// Places in the order of the search: $ECHOFUSE_CONFIG if it is set (then no other), ./lab.toml,
// $XDG_CONFIG_HOME/echofuse/lab.toml (by default in ~/.config), /etc/echofuse/lab.toml.
std::vector<ConfigPlace> config_places();

// Returns the first place with a file. The file named by $ECHOFUSE_CONFIG counts even if missing:
// it was asked for.
std::optional<ConfigPlace> find_config();

// Calls find_config(); without a file throws Error(config) that names all places.
ConfigPlace require_config();

}  // namespace echofuse::acquire
