// SPDX-License-Identifier: MIT
// Drivers of a configuration, and the status of each device.
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
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

// Threading: loop's thread only. Updates the status and forwards everything to `next`.
class Devices final : private SampleSink {
 public:
  struct Status {
    bool configured = false;
    DeviceState state = DeviceState::connecting;
    DeviceInfo info;
    std::uint64_t samples = 0;       // tags or frames
    std::string last_event;          // reason for not streaming, if the driver reported one
    std::optional<Holder> holder{};  // other program that uses the device, which is then not opened

    bool delivers() const { return state == DeviceState::streaming && samples > 0; }
  };

  // Throws Error(config) for an invalid address. `loop`, `config` and `next` must outlive this
  // object. With `raw`, the devices' bytes are captured.
  Devices(port::Loop& loop, const Config& config, SampleSink& next, port::RawKeeper* raw = nullptr);
  ~Devices() override;

  // Takes the locks of all configured devices, for `command` of echofuse-acquire with run file
  // `run`. Throws Error(device) that names another holder.
  void take(const std::string& command, const std::string& run = {});
  // Writes the next run file of `command` into the locks.
  void name_run(const std::string& command, const std::string& run) { locks_->write(command, run); }
  // Takes the locks of the free devices only.
  void take_free(const std::string& command);
  void start();
  // Stops all drivers in parallel and waits. Reports a device that does not confirm as an event.
  void stop();
  // Stops all drivers without events; for use after an exception.
  void abandon();
  // Runs the loop until all our devices deliver data, until the timeout, or until the user
  // interrupts. Returns early if a device is misconfigured.
  void wait(double timeout_s);
  void refuse_misconfigured() const;  // throws Error(config)
  const Status& operator[](Sensor s) const { return status_[s]; }
  // Returns the counters of the sensor's driver, also after its end; empty if the sensor is not
  // configured.
  std::vector<Counter> counters(Sensor s) const;
  // Returns true if the predicate holds for every configured device.
  bool all(const std::function<bool(const Status&)>& predicate) const;
  // Returns "radar serial:/dev/ttyUSB0: faulted: no such file or directory", or the holder.
  std::string describe(Sensor s) const;

 private:
  void on_tags(const TagBlock& block) override;
  void on_histogram(HistogramFrame frame) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_firmware_bias(const FirmwareBias& bias) override { next_->on_firmware_bias(bias); }
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;
  // Warns if another device than before streams.
  void warn_of_another(Sensor sensor, const DeviceInfo& info);
  std::vector<Sensor> halt();
  Status& status(Sensor s) { return status_[s]; }

  port::Loop& loop_;
  const Config& config_;
  SampleSink* next_;
  std::optional<DeviceLocks> locks_;  // must outlive the drivers
  PerSensor<Status> status_;
  PerSensor<std::string> identities_;  // serial number, otherwise the model
  PerSensor<std::unique_ptr<Driver>> drivers_;
  PerSensor<std::vector<Counter>> last_counters_;  // from drivers that ended
};

}  // namespace echofuse::acquire
