// SPDX-License-Identifier: MIT
// The daemon's configuration: a TOML file, read strictly.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/calibrate/calibration.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "acquire/measurement/detector.hpp"
#include "acquire/measurement/radar_array.hpp"
#include "acquire/run/signal_check.hpp"
#include "drivers/make_driver.hpp"
#include "drivers/radar/profile.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

struct Config {
  double window_s = 3;
  double connect_timeout_s = 10;
  std::string label, operator_name;
  std::string run_folder;  // of runs without a name; empty: the working directory
  TdcConfig tdc;
  tdc::HistogramSettings histogram;
  record::Detector detector;
  RadarConfig radar;
  DepthConfig depth;
  record::MapGrid map;
  SignalLimits signal;
  Calibration calibration;       // of the file that run.calibration names
  record::Antennas antennas;     // of the radar's heat map, calibrated; empty: it sends none
  std::string calibration_path;  // that file, or where one would stand
  PerSensor<std::string> policy{"optional", "optional", "optional"};

  std::vector<std::string> unfinished;  // what still has the template's XXXXXXXX, with its place
  std::string text;                     // of the file, verbatim
  std::string resolved;                 // every key with its value and meaning, as TOML
  std::string shown;                    // the same, with the origin of each value

  SensorSet configured() const;  // the sensors that have an address
  SensorSet required() const;    // those that the run does not start without
};

// Reads the file, then applies `assignments` ("key=value"). A radar cfg named in it is read
// relative to the file's folder. Throws Error(config) listing all faults, each with the place of
// its key. Nothing is opened: that an address can be does not mean that a device is there. Without
// `with_calibration` the file of run.calibration is not read: it is about to be written.
Config load_config(const std::string& path, const std::vector<std::string>& assignments = {},
                   bool with_calibration = true);

// What the radar's cfg says. Throws as radar::parse_profile.
radar::RadarProfile parse_profile(const RadarConfig& radar);

struct ConfigPlace {
  std::string path;
  std::string name;  // as a text calls it: "$ECHOFUSE_CONFIG", "./lab.toml"
};

// In the order in which they are looked at: $ECHOFUSE_CONFIG if it is set (then no other),
// ./lab.toml, $XDG_CONFIG_HOME/echofuse/lab.toml (by default in ~/.config),
// /etc/echofuse/lab.toml.
std::vector<ConfigPlace> config_places();

// The first that is there. What $ECHOFUSE_CONFIG names need not be: it was asked for.
std::optional<ConfigPlace> find_config();

// The same; without one an Error(config) that names all places.
ConfigPlace require_config();

}  // namespace echofuse::acquire
