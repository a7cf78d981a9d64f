// SPDX-License-Identifier: MIT
// Creates the driver for an address of the configuration. Supported devices:
//   tdc    bridge:tcp://HOST:PORT | usb:VVVV:PPPP[:serial]
//   radar  serial:/dev/... | hid:VVVV:PPPP[:serial]           (two ports: command line and data)
//          bridge:tcp://HOST:PORT
//   depth  openni:[URI or file.oni] | bridge:tcp://HOST:PORT
// A bad or unsupported address, or an invalid radar cfg, throws Error(ExitCode::config) at
// start-up. DeviceState reports later whether the device answers.
#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "drivers/core/clock.hpp"
#include "drivers/core/driver.hpp"

namespace echofuse {

namespace port {
class Loop;
class RawKeeper;
}  // namespace port

struct TdcConfig {
  std::string address;
};

struct RadarConfig {
  std::string cli, data;                             // addresses of the two ports
  std::string cfg_text;                              // sent unchanged, line by line
  std::string cfg_name;                              // for messages: usually the file name
  static constexpr std::uint32_t cli_baud = 115200;  // TI's out-of-box demo
  std::uint32_t data_baud = 921600;
  std::string board = "isk";  // name in drivers/radar/board_antennas.hpp
  bool keep_running = false;  // do not stop the sensor at the end
  std::string address = {};   // bridge of another radar; the fields above are then unused
};

struct DepthConfig {
  std::string address;
  std::uint32_t width = 0, height = 0, fps = 0;  // OpenNI2 only; 0: camera's default
};

// Checks an address without opening it; throws like make_tdc() and the others.
void check_tdc(const std::string& address);
void check_radar(const std::string& address);
void check_radar_port(const std::string& address, std::uint32_t baud);
void check_depth(const std::string& address);

// `loop` and `raw` must outlive the driver. With `raw`, the device's bytes are stored in
// radar-001.dat and radar-cli-001.txt or radar-001.blocks, tags-001.blocks, depth-001.blocks.
std::unique_ptr<Driver> make_tdc(port::Loop& loop, const TdcConfig& config,
                                 port::RawKeeper* raw = nullptr);
std::unique_ptr<Driver> make_radar(port::Loop& loop, const RadarConfig& config,
                                   port::RawKeeper* raw = nullptr);
std::unique_ptr<Driver> make_depth(port::Loop& loop, const DepthConfig& config,
                                   port::RawKeeper* raw = nullptr);

}  // namespace echofuse
