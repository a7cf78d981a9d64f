// SPDX-License-Identifier: MIT
// Locks of the configured devices: one program at a time has a device, across all users.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/program/lock.hpp"

namespace echofuse::acquire {

struct Holder {
  std::string who;  // "echofuse-acquire run, pid 4711, run /data/monday.sqlite"
  std::string run;  // the run file that it writes; empty: none
};

// A folder that all users share, so that they see each other's locks; $ECHOFUSE_LOCKS, if it is
// set.
std::string lock_folder();

// Name of the lock of a configured address. Another spelling of a serial, USB or HID device's
// address has another lock, and finds the device opened exclusively. Empty: a recording, which
// everybody may read, or an OpenNI2 camera without a URI that is not the only one.
std::string lock_name(const std::string& address);

// Held as long as this lives, also while a device is away or being opened again: nobody else may
// come in between.
class DeviceLocks {
 public:
  // `command`: "run"; `run`: the run file to come. Takes what is free; throws Error(device) if a
  // lock file cannot be used.
  DeviceLocks(const Config& config, const std::string& command, const std::string& run = {});

  // Writes into the locks what this program does.
  void write(const std::string& command, const std::string& run) const;

  // Holder in another process; none if the sensor's device is free or ours.
  const std::optional<Holder>& other(Sensor sensor) const { return others_[sensor]; }

 private:
  PerSensor<std::optional<Holder>> others_;
  std::vector<std::unique_ptr<Lock>> held_;
};

}  // namespace echofuse::acquire
