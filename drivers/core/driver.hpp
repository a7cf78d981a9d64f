// SPDX-License-Identifier: MIT
// The one interface of all devices.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/core/sample.hpp"

namespace echofuse {

enum class DeviceState : std::uint8_t { connecting, streaming, faulted, ended };
inline const char* name_of(DeviceState s) {
  constexpr const char* names[] = {"connecting", "streaming", "faulted", "ended"};
  return names[static_cast<std::size_t>(s)];
}

// Identity and axes of a device, known once it answers.
struct DeviceInfo {
  Sensor sensor{};
  std::string address, model, serial, firmware;
  std::vector<Axis> axes;  // axes of the samples that it sends
};

enum class Severity : std::uint8_t { info, warning, error };

struct Counter {
  const char* name;
  std::uint64_t value;
};

// Overrides what it wants to hear; the rest goes nowhere.
class SampleSink {
 public:
  virtual ~SampleSink() = default;
  virtual void on_tags(const TagBlock&) {}
  virtual void on_histogram(HistogramFrame) {}
  virtual void on_radar(RadarFrame) {}
  virtual void on_depth(DepthFrame) {}
  virtual void on_state(Sensor, DeviceState, const DeviceInfo&) {}
  virtual void on_firmware_bias(const FirmwareBias&) {}  // one line of the radar's calibration
  virtual void on_event(Sensor, Severity, const std::string& /*text*/) {}
};

// Threading: built, started, stopped and destroyed on the loop's thread, and calls its sink there
// only. A driver with threads of its own copies and posts. It reconnects by itself, with back-off,
// until stopped. Stop all drivers before you destroy one: a destructor waits.
class Driver {
 public:
  virtual ~Driver() = default;
  virtual void start(SampleSink& sink) = 0;
  // Asks it to end, and does not wait: its destructor does.
  virtual void stop() = 0;
  // After stop(): whether all commands are with the device, and all that had come from it is
  // with the sink. Until then the loop has to run, for as long as its user likes to wait.
  virtual bool finished() const { return true; }
  // Counters by cause since start (bytes, short, not_ours, corrupt, resynced, reconnects, ...).
  virtual std::vector<Counter> counters() const = 0;
};

}  // namespace echofuse
