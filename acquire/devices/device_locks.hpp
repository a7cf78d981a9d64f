// SPDX-License-Identifier: MIT
// Locks of the configured devices, so that only one program of any user can open a device.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "drivers/util/lock.hpp"

namespace echofuse::acquire {

struct Holder {
  std::string who;  // process, e.g. "echofuse-acquire run, pid 4711, run /data/monday.sqlite"
  std::string run;  // file of the run that the process is recording; may be empty
};

// Returns the addresses of a sensor's device; two for a radar on a command port and a data port.
std::vector<std::string> addresses_of(const Config& config, Sensor sensor);

// Returns the folder of the lock files. All users share it, so that each program sees the locks of
// other users' programs. The environment variable ECHOFUSE_LOCKS overrides the default folder.
std::string lock_folder();

// Returns the file name of the lock for a configured address. Two spellings of one serial, USB or
// HID address result in two locks, but the second program then fails to open the device
// exclusively. Returns an empty name for a recording, because several programs may read it. Also
// returns an empty name for an OpenNI2 address without a URI if several cameras are attached.
std::string lock_name(const std::string& address);

// Locks of this process, held until destruction, including while a device is disconnected or
// reopened.
class DeviceLocks {
 public:
  // Takes all locks that are free. `command` is the name of the command, e.g. "run"; `run` is the
  // path of the run file that the command will create. Throws Error(device) if a lock file cannot
  // be used.
  DeviceLocks(const Config& config, const std::string& command, const std::string& run = {});

  void write(const std::string& command, const std::string& run) const;

  // Returns the process that holds the device, if it is not this process; otherwise nullopt.
  const std::optional<Holder>& other(Sensor sensor) const { return others_[sensor]; }

 private:
  PerSensor<std::optional<Holder>> others_;
  std::vector<std::unique_ptr<Lock>> held_;
};

}  // namespace echofuse::acquire
