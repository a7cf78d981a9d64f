// SPDX-License-Identifier: MIT
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/core/sample.hpp"

namespace echofuse {

// A driver that is `faulted` or `misconfigured` is not connected and keeps trying to connect.
// `misconfigured` means that the configuration is wrong. If a driver enters this state during
// startup, `run` and `calibrate` exit.
enum class DeviceState : std::uint8_t { connecting, streaming, faulted, ended, misconfigured };
inline const char* name_of(DeviceState s) {
  constexpr const char* names[] = {"connecting", "streaming", "faulted", "ended", "misconfigured"};
  return names[static_cast<std::size_t>(s)];
}

// Identity and axes of a device. The fields may be empty until the device responds.
struct DeviceInfo {
  Sensor sensor{};
  std::string address, model, serial, firmware;
  std::vector<Axis> axes;  // axes of the device's samples
};

enum class Severity : std::uint8_t { info, warning, error };

struct Counter {
  const char* name;
  std::uint64_t value;
};

// Receives the samples and events of drivers. The default implementations do nothing.
class SampleSink {
 public:
  virtual ~SampleSink() = default;
  virtual void on_tags(const TagBlock&) {}
  virtual void on_histogram(HistogramFrame) {}
  virtual void on_radar(RadarFrame) {}
  virtual void on_depth(DepthFrame) {}
  virtual void on_state(Sensor, DeviceState, const DeviceInfo&) {}
  virtual void on_firmware_bias(const FirmwareBias&) {}  // one result of the radar's calibration
  virtual void on_event(Sensor, Severity, const std::string& /*text*/) {}
};

// Threading: create, start, stop and destroy a driver on the loop's thread. A driver calls its sink
// only on that thread. A driver's own threads copy their data and post the copies to the loop. A
// driver reconnects with back-off until it is stopped. Stop all drivers before destroying any of
// them, because each destructor waits until its driver has stopped.
class Driver {
 public:
  virtual ~Driver() = default;
  virtual void start(SampleSink& sink) = 0;
  // Requests a stop and returns immediately. The destructor waits until the driver has stopped.
  virtual void stop() = 0;
  // After stop(): returns true once the device has received all commands and the sink has received
  // all data. The caller runs the loop until then, or until its own timeout.
  virtual bool finished() const { return true; }
  // Returns the counters accumulated since start(), for example bytes, frames, bad_headers and
  // lost_frames.
  virtual std::vector<Counter> counters() const = 0;
};

}  // namespace echofuse
