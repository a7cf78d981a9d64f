// SPDX-License-Identifier: MIT
// The drivers of a configuration, and the status of each device.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/devices/device_locks.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/program/exit_code.hpp"

namespace echofuse::acquire {

// Threading: the loop's thread only. Passes everything on to `next`, after taking note of it.
class Devices final : private SampleSink {
 public:
  struct Status {
    bool configured = false;
    DeviceState state = DeviceState::connecting;
    DeviceInfo info;
    std::uint64_t samples = 0;       // tags or frames
    std::string last_event;          // why it does not stream, if it said so
    std::optional<Holder> holder{};  // another program that has it: it is not touched

    bool delivers() const { return state == DeviceState::streaming && samples > 0; }
  };

  // Throws Error(config) for an address that cannot be. `loop`, `config` and `next` must outlive
  // this. Into `raw`, if any, go the devices' bytes.
  Devices(port::Loop& loop, const Config& config, SampleSink& next, port::RawKeeper* raw = nullptr);
  ~Devices() override;

  // Makes the configured devices this program's, `command` of echofuse-acquire, that writes `run`.
  // Throws Error(device) that names who else has one.
  void take(const std::string& command, const std::string& run = {});
  // Names the next run that `command` writes.
  void name_run(const std::string& command, const std::string& run) { locks_->write(command, run); }
  // Makes those of them this program's that are free.
  void take_free(const std::string& command);
  void start();
  // Stops all drivers at once, and waits. A device that does not confirm its end is an event.
  void stop();
  // Stops all drivers without telling anybody: after an exception.
  void abandon();
  // Runs the loop until every configured device that is ours delivers, the time is up or the user
  // interrupts.
  void wait(double timeout_s);
  const Status& operator[](Sensor s) const { return status_[s]; }
  // Counters of the sensor's driver, until it ends; empty if the sensor is not configured.
  std::vector<Counter> counters(Sensor s) const;
  // Asks it of every configured device.
  bool all(const std::function<bool(const Status&)>& predicate) const;
  // "radar serial:/dev/ttyUSB0: faulted: no such file or directory", or by whom it is in use
  std::string describe(Sensor s) const;

 private:
  void on_tags(const TagBlock& block) override;
  void on_histogram(HistogramFrame frame) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_firmware_bias(const FirmwareBias& bias) override { next_->on_firmware_bias(bias); }
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;
  // Warns if this is not the device that streamed before.
  void warn_of_another(Sensor sensor, const DeviceInfo& info);
  std::vector<Sensor> halt();
  Status& status(Sensor s) { return status_[s]; }

  port::Loop& loop_;
  const Config& config_;
  SampleSink* next_;
  std::optional<DeviceLocks> locks_;  // outlive the drivers
  PerSensor<Status> status_;
  PerSensor<std::string> identities_;  // serial numbers, or models without one
  PerSensor<std::unique_ptr<Driver>> drivers_;
  PerSensor<std::vector<Counter>> last_counters_;  // kept from drivers that ended
};

}  // namespace echofuse::acquire
