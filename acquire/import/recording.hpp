// SPDX-License-Identifier: MIT
// A recording of one device, as its samples in the order of the device's clock.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"

namespace echofuse::acquire {

class Recording {
 public:
  virtual ~Recording() = default;
  virtual DeviceInfo device() const = 0;
  // Hands the next samples to the sink, which has none of the other events. All are "received" at
  // the time of the last one, counted from the recording's begin. False at the end. Throws
  // Error(failed) if the file cannot be read on.
  virtual bool next(SampleSink& sink) = 0;
  // Host time of the last samples.
  virtual HostTime at() const = 0;
  virtual std::vector<Counter> counters() const = 0;
  // Sentences about missing or doubtful data, at the end of the recording.
  virtual std::vector<std::string> doubts() const = 0;
};

}  // namespace echofuse::acquire
