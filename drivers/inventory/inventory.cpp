// SPDX-License-Identifier: MIT
#include "drivers/inventory/inventory.hpp"

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "drivers/util/format.hpp"
#include "drivers/util/program.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::inventory {
namespace {

namespace fs = std::filesystem;

// Interface of a USB device, as described by the kernel's files in /sys/bus/usb/devices.
struct UsbInterface {
  unsigned number = 0, device_class = 0, subclass = 0, protocol = 0;
  std::vector<std::string> nodes;  // names in /dev, for example "ttyACM0" or "hidraw3"
};

struct UsbDevice {
  std::uint16_t vendor = 0, product = 0, release_bcd = 0;
  unsigned bus = 0, number = 0;
  std::string place;  // position on the bus, for example "1-2"
  std::string model, serial;
  std::vector<UsbInterface> interfaces;  // sorted by interface number
};

// Number of folder levels to search below an interface. The deepest known node is
// 1-2:1.0/0003:10C4:EA80.0001/hidraw/hidraw0.
constexpr int deepest_node = 5;

// Returns the first line of a sysfs attribute, or an empty string if it cannot be read.
std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

unsigned number_of(const fs::path& file, int base) {
  const std::string text = text_of(file);
  unsigned value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value, base);
  return value;
}

bool real_folder(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(fs::symlink_status(path, error));
}

// Collects the names of character devices. The kernel lists them in folders named after their
// class: .../tty/ttyUSB0, .../hidraw/hidraw0.
void find_nodes(const fs::path& folder, int depth, std::vector<std::string>& nodes) {
  for (const fs::path& entry : entries_of(folder)) {
    if (!real_folder(entry)) continue;
    const std::string name = entry.filename().string();
    if (name == "tty" || name == "hidraw") {
      for (const fs::path& node : entries_of(entry))
        if (real_folder(node)) nodes.push_back(node.filename().string());
    } else if (depth < deepest_node) {
      find_nodes(entry, depth + 1, nodes);
    }
  }
}

UsbInterface read_interface(const fs::path& folder) {
  UsbInterface out;
  out.number = number_of(folder / "bInterfaceNumber", 16);
  out.device_class = number_of(folder / "bInterfaceClass", 16);
  out.subclass = number_of(folder / "bInterfaceSubClass", 16);
  out.protocol = number_of(folder / "bInterfaceProtocol", 16);
  find_nodes(folder, 0, out.nodes);
  return out;
}

UsbDevice read_device(const fs::path& folder) {
  UsbDevice d;
  d.vendor = static_cast<std::uint16_t>(number_of(folder / "idVendor", 16));
  d.product = static_cast<std::uint16_t>(number_of(folder / "idProduct", 16));
  d.release_bcd = static_cast<std::uint16_t>(number_of(folder / "bcdDevice", 16));
  d.bus = number_of(folder / "busnum", 10);
  d.number = number_of(folder / "devnum", 10);
  d.place = folder.filename().string();
  d.model = text_of(folder / "product");
  d.serial = text_of(folder / "serial");
  std::error_code error;
  for (const fs::path& entry : entries_of(fs::canonical(folder, error)))
    if (fs::exists(entry / "bInterfaceNumber", error))
      d.interfaces.push_back(read_interface(entry));
  return d;
}

// Returns all USB devices, sorted by their position on the bus. Returns an empty list if sysfs
// cannot be read.
std::vector<UsbDevice> read_usb_tree(const std::string& sys_root) {
  std::vector<UsbDevice> out;
  for (const fs::path& entry : entries_of(fs::path(sys_root) / "bus/usb/devices")) {
    std::error_code error;
    if (fs::exists(entry / "idVendor", error)) out.push_back(read_device(entry));
  }
  return out;
}

// The USB device to which a device node such as "ttyACM0" belongs, and the interface of the node.
struct NodeOwner {
  UsbDevice device;
  unsigned interface_number = 0;
};
std::optional<NodeOwner> owner_of(const std::string& node, const std::string& sys_root) {
  for (const UsbDevice& device : read_usb_tree(sys_root))
    for (const UsbInterface& interface : device.interfaces)
      if (std::count(interface.nodes.begin(), interface.nodes.end(), node) > 0)
        return NodeOwner{device, interface.number};
  return std::nullopt;
}

enum class Transport { serial, hid, usb };

struct KnownDevice {
  std::uint16_t vendor, product;  // product 0 matches all products of the vendor
  const char* name;
  Transport access;
  // interface number of a radar board's data port; the command port is interface 0
  unsigned data_interface;
  const char* advice;
  const char* model = "";  // substring of the product name; an empty string matches all names
};

constexpr KnownDevice kinds[] = {
    {0x0451, 0xbef3, "TI XDS110 (radar board)", Transport::serial, 3, ""},
    {0x0451, 0xbef4, "TI XDS110 (radar board)", Transport::serial, 3, ""},
    {0x10c4, 0xea70, "CP2105 (radar board)", Transport::serial, 1, ""},
    {0x10c4, 0xea80, "CP2110 HID serial bridge", Transport::hid, 0, ""},
    {0x151f, 0, "Opal Kelly FPGA (Swabian Time Tagger)", Transport::usb, 0,
     "start echofuse-bridge-timetagger: tdc.address = \"bridge:tcp://127.0.0.1:41110\""},
    {0x2bc5, 0, "Orbbec camera", Transport::usb, 0,
     "start echofuse-bridge-orbbec: depth.address = \"bridge:tcp://127.0.0.1:41111\"; cameras that "
     "OpenNI2 supports are listed below with their URI"},
    {0x8086, 0, "RealSense camera", Transport::usb, 0,
     "start echofuse-bridge-realsense: depth.address = \"bridge:tcp://127.0.0.1:41111\"",
     "RealSense"},
};

// USB devices that send a block stream. They are identified by their interface, so all vendor and
// product IDs are accepted (drivers/BRIDGES.md).
constexpr KnownDevice tag_stream{0, 0, "USB time tagger", Transport::usb, 0, ""};

bool streams_tags(const UsbDevice& d) {
  return std::any_of(d.interfaces.begin(), d.interfaces.end(), [](const UsbInterface& i) {
    return i.device_class == 0xff && i.subclass == 0x45 && i.protocol == 0x01;
  });
}

const KnownDevice* kind_of(const UsbDevice& d) {
  if (streams_tags(d)) return &tag_stream;
  for (const KnownDevice& k : kinds)
    if (k.vendor == d.vendor && (k.product == 0 || k.product == d.product) &&
        d.model.find(k.model) != d.model.npos)
      return &k;
  return nullptr;
}

std::string hex4(unsigned value) { return format("%04x", value); }

std::string firmware_of(unsigned bcd) { return format("%x.%02x", bcd >> 8, bcd & 0xffu); }

// Returns a path that remains valid after replugging, or the node itself if udev has not created
// such a path. Uses by-path names for devices that share a serial number, because their by-id names
// are ambiguous.
std::string stable_path(const std::string& node, const Roots& roots, bool shared_serial) {
  std::error_code not_a_link;
  for (const fs::path& link :
       entries_of(fs::path(roots.dev) / (shared_serial ? "serial/by-path" : "serial/by-id")))
    if (fs::read_symlink(link, not_a_link).filename() == node) return link.string();
  return (fs::path(roots.dev) / node).string();
}

std::string lack_of(const std::string& path) {
  if (::access(path.c_str(), R_OK | W_OK) == 0) return {};
  if (errno == EACCES) return "no read/write permission on " + path + ": " + permission_hint(path);
  return path + ": " + std::strerror(errno);
}

Node node_of(const std::string& path, const std::string& key = {},
             const std::string& address = {}) {
  return {path, key, address, lack_of(path)};
}

Node no_node(const std::string& key, const std::string& address, const char* driver) {
  return {"", key, address, std::string("no device node; load the kernel driver ") + driver};
}

std::string by_serial(const char* scheme, const UsbDevice& d) {
  return std::string(scheme) + ':' + hex4(d.vendor) + ':' + hex4(d.product) +
         (d.serial.empty() ? "" : ':' + d.serial);
}

std::vector<Node> serial_nodes(const KnownDevice& kind, const UsbDevice& d, const Roots& roots,
                               bool shared_serial) {
  std::vector<Node> out;
  for (const UsbInterface& interface : d.interfaces) {
    if (interface.number != 0 && interface.number != kind.data_interface) continue;
    const char* key = interface.number == 0 ? "radar.cli" : "radar.data";
    if (interface.nodes.empty()) out.push_back(no_node(key, "", "cdc_acm or cp210x"));
    for (const std::string& name : interface.nodes)
      out.push_back(node_of((fs::path(roots.dev) / name).string(), key,
                            "serial:" + stable_path(name, roots, shared_serial)));
  }
  return out;
}

std::vector<Node> hid_nodes(const UsbDevice& d, const Roots& roots) {
  constexpr const char* key = "radar.cli or radar.data";
  std::vector<Node> out;
  for (const UsbInterface& interface : d.interfaces)
    for (const std::string& name : interface.nodes)
      out.push_back(node_of((fs::path(roots.dev) / name).string(), key, by_serial("hid", d)));
  if (out.empty()) out.push_back(no_node(key, by_serial("hid", d), "hidraw"));
  return out;
}

std::string usb_path(const UsbDevice& d, const Roots& roots) {
  return (fs::path(roots.dev) / format("bus/usb/%03u/%03u", d.bus, d.number)).string();
}

std::vector<Node> usb_nodes(const UsbDevice& d, const Roots& roots) {
  Node node = node_of(usb_path(d, roots));
  if (streams_tags(d)) {
    node.key = "tdc.address";
    node.address = by_serial("usb", d);
  }
  return {node};
}

Attached describe(const KnownDevice& kind, const UsbDevice& d, const Roots& roots,
                  bool shared_serial) {
  Attached out{d.vendor,    d.product, kind.name, d.model, d.serial, firmware_of(d.release_bcd),
               kind.advice, {}};
  if (kind.access == Transport::serial) out.nodes = serial_nodes(kind, d, roots, shared_serial);
  if (kind.access == Transport::serial && shared_serial)
    out.advice =
        "another board has the same serial number " + d.serial +
        ", so these addresses identify USB ports: always plug each board into the same port";
  if (kind.access == Transport::hid) out.nodes = hid_nodes(d, roots);
  if (kind.access == Transport::usb) out.nodes = usb_nodes(d, roots);
  return out;
}

std::optional<RadarPort> role_in(unsigned data_interface, unsigned number) {
  if (number == 0) return RadarPort::command;
  if (number == data_interface) return RadarPort::data;
  return std::nullopt;
}

}  // namespace

std::vector<Attached> list_attached(const Roots& roots) {
  std::vector<Attached> out;
  const auto tree = read_usb_tree(roots.sys);
  for (const UsbDevice& device : tree) {
    const auto same = std::count_if(tree.begin(), tree.end(), [&](const UsbDevice& d) {
      return d.vendor == device.vendor && d.product == device.product && d.serial == device.serial;
    });
    if (const KnownDevice* kind = kind_of(device))
      out.push_back(describe(*kind, device, roots, same > 1 && !device.serial.empty()));
  }
  return out;
}

std::string suspension_switch(const std::string& node_path, const Roots& roots) {
  const std::string node = fs::path(node_path).filename().string();
  for (const UsbDevice& device : read_usb_tree(roots.sys)) {
    const bool owner = usb_path(device, roots) == node_path ||
                       std::ranges::any_of(device.interfaces, [&](const UsbInterface& i) {
                         return std::ranges::count(i.nodes, node) > 0;
                       });
    const fs::path file = fs::path(roots.sys) / "bus/usb/devices" / device.place / "power/control";
    if (owner && text_of(file) == "auto") return file.string();
  }
  return {};
}

std::string two_boards(const std::string& command_path, const std::string& data_path,
                       const Roots& roots) {
  const auto board_of = [&](const std::string& path) -> std::string {
    std::error_code error;
    const auto owner = owner_of(fs::canonical(path, error).filename().string(), roots.sys);
    const KnownDevice* kind = owner ? kind_of(owner->device) : nullptr;
    if (!kind || kind->access != Transport::serial) return {};
    return std::string(kind->name) + ' ' + owner->device.serial + " at USB " + owner->device.place;
  };
  const std::string command = board_of(command_path), data = board_of(data_path);
  if (command.empty() || data.empty() || command == data) return {};
  return command + ", " + data;
}

std::optional<RadarPort> radar_port(const std::string& path, const Roots& roots) {
  const std::string name = fs::path(path).filename().string();
  // Reads the interface number from by-id names such as
  // "usb-Texas_Instruments_XDS110_..._R0081038-if03" or "usb-Silicon_Labs_CP2105_...-if01-port0".
  if (const std::size_t at = name.rfind("-if"); at != name.npos) {
    const unsigned data = name.find("XDS110") != name.npos   ? 3
                          : name.find("CP2105") != name.npos ? 1
                                                             : 0;
    unsigned number = 0;
    const char* digits = name.data() + at + 3;
    const char* end = name.data() + std::min(at + 5, name.size());
    if (data == 0 || end - digits != 2 || std::from_chars(digits, end, number, 16).ptr != end)
      return std::nullopt;
    return role_in(data, number);
  }
  const auto owner = owner_of(name, roots.sys);
  const KnownDevice* kind = owner ? kind_of(owner->device) : nullptr;
  if (!kind || kind->access != Transport::serial) return std::nullopt;
  return role_in(kind->data_interface, owner->interface_number);
}

}  // namespace echofuse::inventory
