// SPDX-License-Identifier: MIT
// Lists the attached USB devices of supported kinds as the kernel reports them, with the lines for
// lab.toml that select them. Does not open or query devices.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::inventory {

// Root folders of sysfs and of the device nodes. Tests replace them with their own folders.
struct Roots {
  std::string sys = "/sys", dev = "/dev";
};

struct Node {
  std::string path;     // for example "/dev/ttyACM0"; may be empty
  std::string key;      // key in lab.toml, for example "radar.cli"; may be empty
  std::string address;  // value to set for the key, for example "serial:/dev/serial/by-id/..."
  std::string missing;  // missing driver, device node or permission; empty if nothing is missing
};

struct Attached {
  std::uint16_t vendor = 0, product = 0;
  std::string kind;      // supported kind, for example "TI XDS110 (radar board)"
  std::string model;     // product name reported by the device
  std::string serial;    // serial number; empty if the device has none
  std::string firmware;  // bcdDevice as text, for example "1.00"
  std::string advice;    // suggested next step; may be empty
  std::vector<Node> nodes;
};

// Returns the devices of supported kinds in the order in which the kernel lists them. Returns an
// empty list if sysfs cannot be read.
std::vector<Attached> list_attached(const Roots& roots = {});

// Returns the name of the sysfs file that lets the kernel suspend the USB device of a device node.
// Returns an empty string if the device stays awake, or if the node belongs to no USB device.
std::string suspension_switch(const std::string& node_path, const Roots& roots = {});

enum class RadarPort { command, data };

// Returns whether `path` (a by-id link or a device node) is the command port or the data port of a
// radar board, or nullopt if this is unknown. On the XDS110, interface 0 is the command port and
// interface 3 is the data port. On the CP2105, these are interfaces 0 and 1.
std::optional<RadarPort> radar_port(const std::string& path, const Roots& roots = {});

// Returns the names of both boards if the two serial ports belong to different radar boards.
// Returns an empty string if both ports belong to the same board, or if a port's board is unknown.
std::string two_boards(const std::string& command_path, const std::string& data_path,
                       const Roots& roots = {});

}  // namespace echofuse::inventory
