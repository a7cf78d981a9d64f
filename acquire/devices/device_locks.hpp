// SPDX-License-Identifier: MIT
// Whose the configured devices are: one program at a time, by locks that all users see.
#pragma once
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/devices/lock_file.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

// By what a device is known, however it is written in the configuration: a serial port and a USB
// device by its node, an OpenNI2 camera by its URI, a bridge by its host and port. Empty: it is not
// there, or has no name of its own (a recording).
std::string lock_name(const std::string& address);

// Held as long as this lives, also while a device is away or being opened again: nobody else may
// come in between. A serial port has two locks: by its address as it is configured, held all the
// time, and by its node as long as that is there. A USB device or a camera that was not there at
// the start has no lock (it is opened exclusively as well).
class DeviceLocks {
 public:
  // `command`: "run"; `run`: the run file to come. Takes what is free; throws Error(device) if a
  // lock file cannot be used.
  DeviceLocks(const Config& config, const std::string& command, const std::string& run = {});

  // Who else has a device of this sensor.
  const std::optional<Holder>& other(Sensor sensor) const { return others_[sensor]; }
  // A serial port went or came: its old node may soon be another device's. Throws as the
  // constructor.
  void follow(Sensor sensor);
  // Of ports that are away by now: a radar has two, and hears of the first one's end only.
  void release_absent();

 private:
  void take(Sensor sensor, const std::string& address, const std::string& name);

  Holder me_;
  PerSensor<std::vector<std::string>> addresses_;
  PerSensor<std::optional<Holder>> others_;
  struct Held {
    std::string name;
    std::unique_ptr<LockFile> file;
  };
  std::map<std::pair<std::string, bool>, Held> held_;  // by address, and whether it is the node's
};

}  // namespace echofuse::acquire
