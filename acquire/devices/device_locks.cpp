// SPDX-License-Identifier: MIT
#include "acquire/devices/device_locks.hpp"

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <utility>
#include <variant>

#include "drivers/core/crc32c.hpp"
#include "drivers/depth/openni_list.hpp"
#include "drivers/port/address.hpp"

namespace echofuse::acquire {
namespace {

std::vector<std::string> addresses_of(const Config& config, Sensor s) {
  if (s == Sensor::spd) return {config.tdc.address};
  if (s == Sensor::depth) return {config.depth.address};
  return {config.radar.cli, config.radar.data};
}

// Of a bridge its host and port, of a serial port its path, of a camera its URI, else the address
// as it is.
std::string known_as(const std::string& address) {
  const port::Address parsed = port::parse_address(address);
  if (const auto* camera = std::get_if<port::OpenNiAddress>(&parsed)) {
    std::error_code none;
    if (!camera->uri.empty())
      return std::filesystem::is_regular_file(camera->uri, none) ? "" : camera->uri;
    const auto cameras = depth::list_openni_devices();  // of several the driver takes none
    return cameras.size() == 1 ? cameras[0].uri : "";
  }
  if (const auto* bridge = std::get_if<port::BridgeAddress>(&parsed)) {
    const bool here =
        bridge->host == "localhost" || bridge->host == "::1" || bridge->host == "127.0.0.1";
    return (here ? "localhost" : bridge->host) + ":" + std::to_string(bridge->port);
  }
  if (const auto* serial = std::get_if<port::SerialAddress>(&parsed))
    return std::filesystem::absolute(serial->path).lexically_normal().string();
  return address;
}

}  // namespace

std::string lock_name(const std::string& address) {
  const std::string kind = address.substr(0, address.find(':')), text = known_as(address);
  if (text.empty()) return {};
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
  char name[80];
  std::snprintf(name, sizeof name, "echofuse-%s-%08x.lock", kind.c_str(),
                unsigned{crc32c({bytes, text.size()})});
  return name;
}

DeviceLocks::DeviceLocks(const Config& config, const std::string& command, const std::string& run) {
  const Holder me{"echofuse-acquire " + command + ", pid " + std::to_string(::getpid()) +
                      (run.empty() ? "" : ", run " + run),
                  run};
  for (const Sensor s : all_sensors) {
    if (!config.configured().contains(s)) continue;
    for (const std::string& address : addresses_of(config, s)) {
      const std::string name = lock_name(address);
      if (name.empty()) continue;
      auto file = std::make_unique<LockFile>(lock_folder(), name, me);
      if (file->other())
        others_[s] = file->other();
      else
        held_.push_back(std::move(file));
    }
  }
}

}  // namespace echofuse::acquire
