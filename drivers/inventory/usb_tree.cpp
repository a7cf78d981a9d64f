// SPDX-License-Identifier: MIT
#include "drivers/inventory/usb_tree.hpp"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <optional>

namespace echofuse::inventory {
namespace {

namespace fs = std::filesystem;

constexpr int deepest_node = 5;  // 1-2:1.0/0003:10C4:EA80.0001/hidraw/hidraw0, and some air

// The first line of an attribute; empty if it cannot be read.
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

// Sorted, so that a listing does not depend on the file system; errors are an empty list.
std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> out;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    out.push_back(it->path());
  std::sort(out.begin(), out.end());
  return out;
}

bool real_folder(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(fs::symlink_status(path, error));
}

// Character devices lie in a folder named after their class: .../tty/ttyUSB0, .../hidraw/hidraw0.
void find_nodes(const fs::path& folder, int depth, std::vector<std::string>& nodes) {
  for (const fs::path& entry : entries(folder)) {
    if (!real_folder(entry)) continue;
    const std::string name = entry.filename().string();
    if (name == "tty" || name == "hidraw") {
      for (const fs::path& node : entries(entry))
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
  d.model = text_of(folder / "product");
  d.serial = text_of(folder / "serial");
  std::error_code error;
  for (const fs::path& entry : entries(fs::canonical(folder, error)))
    if (fs::exists(entry / "bInterfaceNumber", error))
      d.interfaces.push_back(read_interface(entry));
  return d;
}

}  // namespace

std::vector<UsbDevice> read_usb_tree(const std::string& sys_root) {
  std::vector<UsbDevice> out;
  for (const fs::path& entry : entries(fs::path(sys_root) / "bus/usb/devices")) {
    std::error_code error;
    if (fs::exists(entry / "idVendor", error)) out.push_back(read_device(entry));
  }
  return out;
}

std::optional<NodeOwner> owner_of(const std::string& node, const std::string& sys_root) {
  for (const UsbDevice& device : read_usb_tree(sys_root))
    for (const UsbInterface& interface : device.interfaces)
      if (std::count(interface.nodes.begin(), interface.nodes.end(), node) > 0)
        return NodeOwner{device, interface.number};
  return std::nullopt;
}

}  // namespace echofuse::inventory
