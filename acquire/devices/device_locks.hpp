// SPDX-License-Identifier: MIT
// Locks of the configured devices: one program per device, across all users.
#pragma once
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/util/lock.hpp"

namespace echofuse::acquire {

struct Holder {
  std::string who;  // "echofuse-acquire run, pid 4711, run /data/monday.sqlite"
  std::string run;  // run file that it writes; may be empty
};

// Returns a folder common to all users, so that their locks are visible to each other;
// $ECHOFUSE_LOCKS overrides it.
std::string lock_folder();

// Returns the lock name of a configured address. Another spelling of a serial, USB or HID address
// has another lock, but the exclusive open then fails. Empty for a recording, which several
// programs may read, and for an OpenNI2 address without a URI if there are several cameras.
std::string lock_name(const std::string& address);

// Locks of this process, held until destruction, including while a device is disconnected or
// reopened.
class DeviceLocks {
 public:
  // Takes the free locks. `command`: "run"; `run`: path of the future run file. Throws
  // Error(device) if a lock file cannot be used.
  DeviceLocks(const Config& config, const std::string& command, const std::string& run = {});

  // Writes command and run file of this program into its locks.
  void write(const std::string& command, const std::string& run) const;

  // Returns the holder in another process; nullopt if the device is free or ours.
  const std::optional<Holder>& other(Sensor sensor) const { return others_[sensor]; }

 private:
  PerSensor<std::optional<Holder>> others_;
  std::vector<std::unique_ptr<Lock>> held_;
};

}  // namespace echofuse::acquire
