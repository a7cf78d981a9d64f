// SPDX-License-Identifier: MIT
// Attached devices, as the kernel lists them: the USB devices that may be one of ours, how a
// program reaches them, and what goes into lab.toml. Nothing is opened and nothing asked of a
// device.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::inventory {

// Roots of the kernel's files; other ones in tests.
struct Roots {
  std::string sys = "/sys", dev = "/dev";
};

struct Node {
  std::string path;     // /dev/ttyACM0; empty: the kernel has none
  std::string key;      // key in lab.toml, as "radar.cli"; empty: nothing to write
  std::string address;  // its value: "serial:/dev/serial/by-id/..."
  std::string missing;  // obstacle for this user: a driver, a node, a permission; or empty
};

struct Attached {
  std::uint16_t vendor = 0, product = 0;
  std::string kind;      // "TI XDS110 (radar board)"
  std::string model;     // the device's own product string
  std::string serial;    // empty: it has none
  std::string firmware;  // bcdDevice: "1.00"
  std::string advice;    // further step; may be empty
  std::vector<Node> nodes;
};

// Devices that may be ours, in the kernel's order. A tree that cannot be read is an empty list.
std::vector<Attached> list_attached(const Roots& roots = {});

enum class RadarPort { command, data };

// Which of a radar board's ports a path (a by-id link or a device node) is, if that can be told:
// XDS110 interface 00 is the command line and 03 the data port, CP2105 interface 00 and 01.
std::optional<RadarPort> radar_port(const std::string& path, const Roots& roots = {});

// Names both boards if these serial ports belong to two radar boards; empty: one board, or unknown.
std::string two_boards(const std::string& command_path, const std::string& data_path,
                       const Roots& roots = {});

}  // namespace echofuse::inventory
