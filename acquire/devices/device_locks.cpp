// SPDX-License-Identifier: MIT
#include "acquire/devices/device_locks.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <thread>
#include <utility>
#include <variant>

#include "drivers/core/crc32c.hpp"
#include "drivers/depth/openni_camera.hpp"
#include "drivers/port/address.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

// Returns the name under which a device is locked: host and port of a bridge, path of a serial
// port, or URI of a camera. Any other device is locked under its address.
std::string known_as(const std::string& address) {
  const port::Address parsed = port::parse_address(address);
  if (const auto* camera = std::get_if<port::OpenNiAddress>(&parsed)) {
    std::error_code none;
    if (!camera->uri.empty())
      return std::filesystem::is_regular_file(camera->uri, none) ? "" : camera->uri;
    // An address without a URI is valid only if one camera is attached; otherwise the driver
    // rejects it.
    const auto cameras = depth::list_openni_devices();
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

// Returns the process that holds the lock; nullopt if the lock is free.
std::optional<Holder> holder_of(const std::string& path) {
  // Maximum time from taking a lock to writing the holder's name into it.
  constexpr auto write_time = std::chrono::milliseconds(20);
  for (int tries = 0;; ++tries) {
    const auto text = Lock::holder(path);
    if (!text) return std::nullopt;
    const std::size_t end = text->find('\n');
    if (end + 1 < text->size() && text->ends_with('\n'))
      return Holder{printable(text->substr(0, end)), text->substr(end + 1, text->size() - end - 2)};
    if (tries == 2) return Holder{"another echofuse-acquire", ""};
    std::this_thread::sleep_for(write_time);
  }
}

std::string text_of(const std::string& command, const std::string& run) {
  return printable("echofuse-acquire " + command + ", pid " + std::to_string(::getpid()) +
                   (run.empty() ? "" : ", run " + run)) +
         '\n' + run + '\n';
}

}  // namespace

std::vector<std::string> addresses_of(const Config& config, Sensor s) {
  if (s == Sensor::spd) return {config.tdc.address};
  if (s == Sensor::depth) return {config.depth.address};
  if (!config.radar.address.empty()) return {config.radar.address};
  return {config.radar.cli, config.radar.data};
}

// Uses /run/lock if all users can write to it, as on Debian; otherwise /tmp.
std::string lock_folder() {
  if (const char* named = std::getenv("ECHOFUSE_LOCKS"); named && *named) return named;
  constexpr const char* usual = "/run/lock";
  struct stat is {};
  const bool shared = ::stat(usual, &is) == 0 && S_ISDIR(is.st_mode) && (is.st_mode & S_IWOTH) != 0;
  return shared ? usual : "/tmp";
}

std::string lock_name(const std::string& address) {
  const std::string kind = address.substr(0, address.find(':')), text = known_as(address);
  if (text.empty()) return {};
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
  return format("echofuse-%s-%08x.lock", kind.c_str(), unsigned{crc32c({bytes, text.size()})});
}

DeviceLocks::DeviceLocks(const Config& config, const std::string& command, const std::string& run) {
  for (const Sensor s : all_sensors) {
    if (!config.configured().contains(s)) continue;
    for (const std::string& address : addresses_of(config, s)) {
      const std::string name = lock_name(address), path = lock_folder() + "/" + name;
      if (name.empty()) continue;
      try {
        auto lock = std::make_unique<Lock>(path, 0666);
        if (!lock->held()) {
          others_[s] = holder_of(path).value_or(Holder{"another echofuse-acquire", ""});
          continue;
        }
        lock->write(text_of(command, run));
        held_.push_back(std::move(lock));
      } catch (const Error& e) {
        throw Error(ExitCode::device, std::string("the device lock ") + e.what());
      }
    }
  }
}

void DeviceLocks::write(const std::string& command, const std::string& run) const {
  for (const auto& lock : held_) lock->write(text_of(command, run));
}

}  // namespace echofuse::acquire
