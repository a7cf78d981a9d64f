// SPDX-License-Identifier: MIT
// What a run that another program records tells of a device, for those who may not ask it.
#pragma once
#include <string>

#include "acquire/devices/device_locks.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/sample.hpp"

namespace echofuse::acquire {

struct LiveDevice {
  std::string text;       // "in use by ...; record 7, 0.4 s ago: ok, 60 frames used, 0 lost"
  bool delivers = false;  // it is valid in the run's last record
};

// Reads the run file that the holder of the sensor's device writes, and nothing else.
LiveDevice inspect_holder(const Holder& holder, Sensor sensor, const Clock& clock);

}  // namespace echofuse::acquire
