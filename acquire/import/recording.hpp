// SPDX-License-Identifier: MIT
// A recording of one device: samples in the order of the device's clock.
#pragma once
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"

namespace echofuse::acquire {

class Recording {
 public:
  virtual ~Recording() = default;
  virtual DeviceInfo device() const = 0;
  // Passes the next samples to the sink, but no other events. All these samples get the same
  // arrival time: the time of the last sample, relative to the start of the recording. Returns
  // false at the end of the recording. Throws Error(failed) on a read error.
  virtual bool next(SampleSink& sink) = 0;
  // Returns the host time of the last samples.
  virtual HostTime at() const = 0;
  virtual std::vector<Counter> counters() const = 0;
  // Returns false if a record without this recording would contain the same information.
  virtual bool usable() const { return true; }
  // Returns warnings about missing or doubtful data. May be called only after the end of the
  // recording.
  virtual std::vector<std::string> doubts() const = 0;
};

}  // namespace echofuse::acquire
