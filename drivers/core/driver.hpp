// SPDX-License-Identifier: MIT
// Common interface of all drivers.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/core/sample.hpp"
#include "drivers/core/zone.hpp"

namespace echofuse {

// In the states `faulted` and `misconfigured` the driver is not connected and tries again.
// `misconfigured`: the configuration is wrong, so `run` and `calibrate` stop at the start.
enum class DeviceState : std::uint8_t { connecting, streaming, faulted, ended, misconfigured };
inline const char* name_of(DeviceState s) {
  constexpr const char* names[] = {"connecting", "streaming", "faulted", "ended", "misconfigured"};
  return names[static_cast<std::size_t>(s)];
}

// Identity and axes of a device, available after its first answer.
struct DeviceInfo {
  Sensor sensor{};
  std::string address, model, serial, firmware;
  std::vector<Axis> axes;  // axes of the samples that it sends
  Zones zones = {};        // empty for a single pixel
};

enum class Severity : std::uint8_t { info, warning, error };

struct Counter {
  const char* name;
  std::uint64_t value;
};

// Receives samples and events. The default implementations ignore them.
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

// Threading: created, started, stopped and destroyed on the loop's thread; calls its sink only
// there. A driver with its own threads copies and posts. Reconnects with back-off until stopped.
// Stop all drivers before destroying one, because a destructor blocks.
class Driver {
 public:
  virtual ~Driver() = default;
  virtual void start(SampleSink& sink) = 0;
  // Requests the end without waiting; the destructor waits.
  virtual void stop() = 0;
  // After stop(): returns true when the device has received all commands and the sink has received
  // all data. The caller runs the loop until then, or until its own timeout.
  virtual bool finished() const { return true; }
  // Returns counters by cause since start (bytes, short, not_ours, corrupt, resynced, reconnects,
  // ...).
  virtual std::vector<Counter> counters() const = 0;
};

}  // namespace echofuse
