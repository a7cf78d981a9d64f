// SPDX-License-Identifier: MIT
// Lists the attached USB devices of supported kinds as the kernel reports them, with the lines for
// lab.toml that select them. Does not open or query devices.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::inventory {

// Root folders of the kernel's device files. Tests replace them with folders of their own.
struct Roots {
  std::string sys = "/sys", dev = "/dev";
};

struct Node {
  std::string path;     // for example "/dev/ttyACM0"; may be empty
  std::string key;      // key in lab.toml, for example "radar.cli"; may be empty
  std::string address;  // value for the key: "serial:/dev/serial/by-id/..."
  std::string missing;  // missing driver, node or permission; empty if nothing is missing
};

struct Attached {
  std::uint16_t vendor = 0, product = 0;
  std::string kind;      // supported kind, for example "TI XDS110 (radar board)"
  std::string model;     // product name reported by the device
  std::string serial;    // serial number; empty if the device has none
  std::string firmware;  // bcdDevice as text, for example "1.00"
  std::string advice;    // advice on the next step; may be empty
  std::vector<Node> nodes;
};

// Returns the devices of supported kinds in the order in which the kernel lists them. Returns an
// empty list if sysfs cannot be read.
std::vector<Attached> list_attached(const Roots& roots = {});

enum class RadarPort { command, data };

// Returns whether a path (by-id link or device node) is the command port or the data port of a
// radar board. Returns nullopt if this is unknown. On the XDS110, interface 0 is the command port
// and interface 3 the data port; on the CP2105, the command port is interface 0 and the data port
// interface 1.
std::optional<RadarPort> radar_port(const std::string& path, const Roots& roots = {});

// Returns the names of both boards if the two serial ports belong to different radar boards.
// Returns an empty string if they belong to one board, or if a board is unknown.
std::string two_boards(const std::string& command_path, const std::string& data_path,
                       const Roots& roots = {});

}  // namespace echofuse::inventory
