// SPDX-License-Identifier: MIT
#include "acquire/devices/device_locks.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <thread>
#include <variant>

#include "drivers/core/crc32c.hpp"
#include "drivers/depth/openni_list.hpp"
#include "drivers/inventory/usb_tree.hpp"
#include "drivers/port/address.hpp"

namespace echofuse::acquire {
namespace {

constexpr int most_tries = 6;
constexpr auto notice_time = std::chrono::milliseconds(50);

template <class... Values>
std::string format(const char* pattern, Values... values) {
  char text[80];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

std::string by_text(const char* kind, const std::string& text) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
  return format("echofuse-%s-%08x.lock", kind, unsigned{crc32c({bytes, text.size()})});
}

std::string by_node(const std::string& path) {
  struct stat is {};
  if (::stat(path.c_str(), &is) != 0) return {};
  return format("echofuse-node-%llx-%llx.lock", static_cast<unsigned long long>(is.st_dev),
                static_cast<unsigned long long>(is.st_ino));
}

// Of several that fit none is meant: their driver will refuse.
template <class UsbIds>
std::string by_usb_ids(const UsbIds& wanted) {
  std::string node;
  for (const auto& d : inventory::read_usb_tree("/sys")) {
    if (d.vendor != wanted.vendor || d.product != wanted.product) continue;
    if (!wanted.serial.empty() && d.serial != wanted.serial) continue;
    if (!node.empty()) return {};
    node = format("/dev/bus/usb/%03u/%03u", d.bus, d.number);
  }
  return node.empty() ? "" : by_node(node);
}

std::string by_camera(const std::string& uri) {
  std::error_code none;
  if (std::filesystem::is_regular_file(uri, none)) return {};
  const auto cameras = depth::list_openni_devices();
  if (uri.empty() && cameras.size() != 1) return {};
  return by_text("openni", uri.empty() ? cameras[0].uri : uri);
}

bool is_serial(const std::string& address) { return address.starts_with("serial:"); }

std::vector<std::string> addresses_of(const Config& config, Sensor s) {
  if (s == Sensor::spd) return {config.tdc.address};
  if (s == Sensor::depth) return {config.depth.address};
  return {config.radar.cli, config.radar.data};
}

}  // namespace

std::string lock_name(const std::string& address) {
  const port::Address parsed = port::parse_address(address);
  if (const auto* serial = std::get_if<port::SerialAddress>(&parsed)) return by_node(serial->path);
  if (const auto* usb = std::get_if<port::UsbAddress>(&parsed)) return by_usb_ids(*usb);
  if (const auto* hid = std::get_if<port::HidAddress>(&parsed)) return by_usb_ids(*hid);
  if (const auto* camera = std::get_if<port::OpenNiAddress>(&parsed)) return by_camera(camera->uri);
  const auto& bridge = std::get<port::BridgeAddress>(parsed);
  const bool here =
      bridge.host == "localhost" || bridge.host == "::1" || bridge.host == "127.0.0.1";
  return by_text("bridge", (here ? "localhost" : bridge.host) + ":" + std::to_string(bridge.port));
}

DeviceLocks::DeviceLocks(const Config& config, const std::string& command, const std::string& run)
    : me_{"echofuse-acquire " + command + ", pid " + std::to_string(::getpid()) +
              (run.empty() ? "" : ", run " + run),
          run} {
  for (const Sensor s : all_sensors) {
    if (!config.configured().contains(s)) continue;
    addresses_[s] = addresses_of(config, s);
    for (const std::string& address : addresses_[s]) {
      if (is_serial(address)) take(s, address, by_text("serial", address));
      const bool may_come_free = is_serial(address) && !others_[s];
      take(s, address, lock_name(address));
      // The node of a port that another program just lost: it lets go of it as it notices.
      for (int tries = 0; tries < most_tries && may_come_free && others_[s]; ++tries) {
        std::this_thread::sleep_for(notice_time);
        others_[s].reset();
        take(s, address, lock_name(address));
      }
    }
  }
}

void DeviceLocks::take(Sensor sensor, const std::string& address, const std::string& name) {
  if (name.empty()) return;
  auto file = std::make_unique<LockFile>(lock_folder(), name, me_);
  if (file->other())
    others_[sensor] = file->other();
  else
    held_[{address, name.find("-node-") != name.npos}] = {name, std::move(file)};
}

void DeviceLocks::follow(Sensor sensor) {
  release_absent();
  for (const std::string& address : addresses_[sensor])
    if (is_serial(address) && !held_.contains({address, true}))
      take(sensor, address, lock_name(address));
}

void DeviceLocks::release_absent() {
  std::erase_if(held_, [](const auto& entry) {
    const auto& [address, of_node] = entry.first;
    return of_node && is_serial(address) && lock_name(address) != entry.second.name;
  });
}

}  // namespace echofuse::acquire
