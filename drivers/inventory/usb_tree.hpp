// SPDX-License-Identifier: MIT
// The kernel's USB devices under /sys/bus/usb/devices, read without a library.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace echofuse::inventory {

struct UsbInterface {
  unsigned number = 0, device_class = 0, subclass = 0, protocol = 0;
  std::vector<std::string> nodes;  // names below /dev: "ttyACM0", "hidraw3"
};

struct UsbDevice {
  std::uint16_t vendor = 0, product = 0, release_bcd = 0;
  unsigned bus = 0, number = 0;
  std::string model, serial;
  std::vector<UsbInterface> interfaces;  // by number
};

// All devices, by their place in the tree; empty if it cannot be read.
std::vector<UsbDevice> read_usb_tree(const std::string& sys_root);

// The device with this node of its own ("ttyACM0"), and which of its interfaces that is.
struct NodeOwner {
  UsbDevice device;
  unsigned interface_number = 0;
};
std::optional<NodeOwner> owner_of(const std::string& node, const std::string& sys_root);

}  // namespace echofuse::inventory
