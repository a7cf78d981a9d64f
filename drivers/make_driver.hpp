// SPDX-License-Identifier: MIT
// Creates the driver for an address of the configuration. Supported devices:
//   tdc    bridge:tcp://HOST:PORT | usb:VVVV:PPPP[:serial]
//   radar  serial:/dev/... | hid:VVVV:PPPP[:serial]           (two ports: command line and data)
//          bridge:tcp://HOST:PORT
//   depth  openni:[URI or file.oni] | bridge:tcp://HOST:PORT
// A bad or unsupported address, or an invalid radar cfg, throws Error(ExitCode::config) at
// start-up. DeviceState later reports whether the device responds.
#pragma once
#include <cstdint>
#include <memory>
#include <string>

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
  std::string cli, data;  // addresses of the command port and the data port
  std::string cfg_text;   // text of the .cfg file, which is sent line by line
  std::string cfg_name;   // name of the cfg used in messages, usually its file name
  // baud rate of the command port in TI's out-of-box demo
  static constexpr std::uint32_t cli_baud = 115200;
  std::uint32_t data_baud = 921600;
  std::string board = "isk";  // name of the board, as listed in drivers/radar/board_antennas.hpp
  bool keep_running = false;  // true: the radar keeps running when the driver stops
  std::string address = {};   // address of a bridge; if it is set, the fields above are not used
};

struct DepthConfig {
  std::string address;
  // used only for OpenNI2 cameras; 0 selects the camera's default
  std::uint32_t width = 0, height = 0, fps = 0;
};

// Checks an address without opening the device. Throws Error(config) for an invalid or unsupported
// address.
void check_tdc(const std::string& address);
void check_radar(const std::string& address);
void check_radar_port(const std::string& address, std::uint32_t baud);
void check_depth(const std::string& address);

// `loop` and `raw` must outlive the driver. If `raw` is set, it stores the received bytes. Bytes
// from bridges are stored in tags-001.blocks, radar-001.blocks and depth-001.blocks; bytes from a
// TI radar are stored in radar-001.dat and radar-cli-001.txt.
std::unique_ptr<Driver> make_tdc(port::Loop& loop, const TdcConfig& config,
                                 port::RawKeeper* raw = nullptr);
std::unique_ptr<Driver> make_radar(port::Loop& loop, const RadarConfig& config,
                                   port::RawKeeper* raw = nullptr);
std::unique_ptr<Driver> make_depth(port::Loop& loop, const DepthConfig& config,
                                   port::RawKeeper* raw = nullptr);

}  // namespace echofuse
