// SPDX-License-Identifier: MIT
// Attached USB devices of supported kinds, as the kernel lists them: how a program reaches them,
// and their lines for lab.toml. Does not open or query devices.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::inventory {

// Root folders of the kernel's files; tests replace them.
struct Roots {
  std::string sys = "/sys", dev = "/dev";
};

struct Node {
  std::string path;     // /dev/ttyACM0; empty: no node exists
  std::string key;      // key in lab.toml ("radar.cli"); empty: no key
  std::string address;  // its value: "serial:/dev/serial/by-id/..."
  std::string missing;  // missing driver, node or permission; or empty
};

struct Attached {
  std::uint16_t vendor = 0, product = 0;
  std::string kind;      // "TI XDS110 (radar board)"
  std::string model;     // the device's own product string
  std::string serial;    // empty: none
  std::string firmware;  // bcdDevice: "1.00"
  std::string advice;    // next step; may be empty
  std::vector<Node> nodes;
};

// Returns devices of supported kinds in the kernel's order; empty if the tree cannot be read.
std::vector<Attached> list_attached(const Roots& roots = {});

enum class RadarPort { command, data };

// Returns the radar port of a path (a by-id link or a device node), if it can be determined.
// XDS110: interface 00 is the command port and 03 the data port; CP2105: 00 and 01.
std::optional<RadarPort> radar_port(const std::string& path, const Roots& roots = {});

// Names both boards if these serial ports belong to two radar boards. Empty: one board, or unknown.
std::string two_boards(const std::string& command_path, const std::string& data_path,
                       const Roots& roots = {});

}  // namespace echofuse::inventory
