// SPDX-License-Identifier: MIT
// Second stage of the intake: returns one record with verdicts for each slot. The first stage is
// acquire/devices/devices.hpp.
#pragma once
#include "acquire/config/config.hpp"
#include "acquire/intake/signal_check.hpp"
#include "acquire/intake/window.hpp"

namespace echofuse::acquire {

class Intake {
 public:
  // `window_s` is the duration of a slot. `clocks` belongs to the Devices that pass on the
  // samples; it must outlive this object.
  Intake(const Config& config, double window_s, const SensorClocks& clocks);

  // Begins slot 0 at the time `first`. Samples that were added before are counted as early.
  void begin(HostTime first) { slots.begin(first); }
  // The sensor's device has ended. No samples are expected after the time `at`.
  void end(Sensor sensor, HostTime at) { ends_[sensor] = at; }
  // Closes a slot of `slots` and sets the verdicts of its record.
  record::FusedRecord close(const DueSlot& due);

  Windows slots;

 private:
  SignalCheck check_;
  SignalCheck::RecordingEnds ends_;
};

}  // namespace echofuse::acquire
