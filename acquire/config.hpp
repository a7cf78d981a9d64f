// SPDX-License-Identifier: MIT
// The daemon's configuration: a TOML file, read strictly.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/make_driver.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

struct Config {
  double window_s = 3;
  double connect_timeout_s = 10;
  std::string label, operator_name;
  TdcConfig tdc;
  tdc::HistogramSettings histogram;
  RadarConfig radar;
  DepthConfig depth;
  std::array<std::string, sensor_count> policy{"optional", "optional", "optional"};

  std::string text;      // of the file, verbatim
  std::string resolved;  // every key with its value and meaning, as TOML

  // The sensors that have an address: bit 0 SPD, 1 radar, 2 depth.
  std::uint32_t configured() const;
  // Those that the run does not start without.
  std::uint32_t required() const;
};

// Reads the file, then applies `assignments` ("key=value"). A radar cfg named in it is read
// relative to the file's folder. Throws Error(config) listing all faults.
Config load_config(const std::string& path, const std::vector<std::string>& assignments = {});

}  // namespace echofuse::acquire
