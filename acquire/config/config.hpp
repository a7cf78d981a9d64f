// SPDX-License-Identifier: MIT
// Configuration of echofuse-acquire: a TOML file, in which unknown keys and sections are errors.
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

// Limits of the signal checks (keys signal.*); 0 disables a check.
struct SignalLimits {
  double weak_share = 0.1, spd_clicks = 1000, clicks_per_pulse = record::max_clicks_per_pulse;
  double radar_snr_db = 6, depth_share = 0.005, lossy_share = 0.8;
};
void bind_limits(Settings& settings, SignalLimits& limits);  // adds the keys signal.*

// Values of all configuration keys. bind() in config.cpp describes each key.
struct Config {
  double window_s = 3, connect_timeout_s = 10;
  std::string label, operator_name, run_folder;
  TdcConfig tdc;
  tdc::HistogramSettings histogram;
  double laser_rate_hz = 0;  // laser pulse rate; 0 if unknown
  record::Detector detector;
  RadarConfig radar;
  double baseline_m = 0.5;  // distance from the detector to the centre of the radar antennas
  // Standard deviation of the change of the range difference R - r since the calibration.
  double mount_tolerance_m = record::RadarMounting{}.tolerance_m;
  DepthConfig depth;
  record::MapGrid map;
  SignalLimits signal;
  record::AlertLimits alert;
  // Program and arguments of alert.on_doubt. They are omitted from `resolved`, which is stored in
  // runs.
  std::vector<std::string> on_doubt;
  Calibration calibration;
  record::Antennas antennas;     // empty if the radar sends no heat map
  std::string calibration_path;  // path of the calibration file, which may not exist yet
  PerSensor<std::string> policy{"optional", "optional", "optional"};

  // Errors reported only by `config check` and `doctor`, with their origin: placeholders left from
  // the template, and a missing program in alert.on_doubt.
  std::vector<std::string> unfinished;
  std::string text;      // verbatim contents of the configuration file
  std::string resolved;  // all keys with their values and descriptions, as TOML
  std::string shown;     // like `resolved`, but with the origin of each value

  SensorSet configured() const;  // sensors for which an address is configured
  SensorSet required() const;    // sensors that must deliver data before a run starts
  // Returns the configured rates of start pulses, radar frames and camera frames, per second; 0 if
  // unknown.
  PerSensor<double> nominal_hz() const;
};

// Reads the file, then applies `assignments` ("key=value"). Paths are relative to the file's
// folder. Throws Error(config) that lists all errors, each with the origin of its key. Does not
// open any device, so a configured device may be missing. Also reads the calibration file if
// `with_calibration` is set; commands that overwrite this file do not set it.
Config load_config(const std::string& path, const std::vector<std::string>& assignments = {},
                   bool with_calibration = true);

// Parses the radar's .cfg text. Throws the same errors as radar::parse_profile.
radar::RadarProfile parse_profile(const RadarConfig& radar);

struct ConfigPlace {
  std::string path;
  std::string name;  // name in messages, e.g. "$ECHOFUSE_CONFIG" or "./lab.toml"
};

// Returns the paths that are searched for a configuration file. If $ECHOFUSE_CONFIG is set, this is
// the only path. Otherwise, the paths are, in order: ./lab.toml, $XDG_CONFIG_HOME/echofuse/lab.toml
// (default ~/.config), /etc/echofuse/lab.toml.
std::vector<ConfigPlace> config_places();

// Returns the first configuration file that exists. A file named by $ECHOFUSE_CONFIG is returned
// even if it is missing, because the user asked for it.
std::optional<ConfigPlace> find_config();

// Returns the result of find_config(). Throws Error(config) that lists all searched paths if no
// configuration file exists.
ConfigPlace require_config();

}  // namespace echofuse::acquire
