// SPDX-License-Identifier: MIT
// Owns the drivers of the configured devices, and tracks the status of each device. First stage of
// the intake, for every command that reads devices: checks and repairs the samples, and fits the
// clocks of the devices. The second stage is acquire/intake/intake.hpp.
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/devices/device_locks.hpp"
#include "acquire/intake/clock_fit.hpp"
#include "acquire/intake/sample_check.hpp"
#include "acquire/intake/tag_check.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::acquire {

// Receives the samples and events of the drivers, updates the status, and passes them to `next`,
// with repaired tags and without lost histograms. Reports each fault to `next` as a warning.
// clocks() has observed every sample before it is passed on, so that it contains the host time of
// the sample. Threading: used only on the loop's thread.
class Devices final : private SampleSink {
 public:
  struct Status {
    bool configured = false;
    DeviceState state = DeviceState::connecting;
    DeviceInfo info;
    std::uint64_t samples = 0;
    std::string last_event;
    // Reason why samples are not used: the last error, or else the first warning since streaming.
    std::string refusal{};
    bool refused = false;            // true if `refusal` is an error
    std::optional<Holder> holder{};  // set if another program uses the device

    bool delivers() const { return state == DeviceState::streaming && samples > 0; }
  };

  // Throws Error(config) for an invalid address. `loop`, `config` and `next` must outlive this
  // object. If `raw` is not null, it receives the raw bytes of all devices. If `recording` is not
  // empty, it creates the devices, which play recordings. Recordings compute the arrival times from
  // the device clocks: no clock is compared with the arrival times, and the faults of tags are
  // reported at the end.
  using MakeRecording = std::function<std::unique_ptr<Driver>(Sensor)>;
  Devices(port::Loop& loop, const Config& config, SampleSink& next, port::RawKeeper* raw = nullptr,
          const MakeRecording& recording = {});
  ~Devices() override;

  // Takes the locks of all configured devices and writes the `command` of echofuse-acquire and the
  // path of the `run` file into them. Throws Error(device) that names the program holding a lock.
  void take(const std::string& command, const std::string& run = {});
  void name_run(const std::string& command, const std::string& run) { locks_->write(command, run); }
  // Takes only the locks that are free.
  void take_free(const std::string& command);
  void start();
  // Stops all drivers in parallel, waits for them, passes on the tags that wait for later tags, and
  // reports the faults that have not been reported yet. Sends a warning to `next` for each device
  // that does not confirm the stop.
  void stop();
  // Stops all drivers without sending events; for use after an exception.
  void abandon();
  // Runs the loop until all configured devices deliver data or are in use by another program.
  // Returns earlier if the timeout has expired, a device is misconfigured, or the user interrupts
  // the program.
  void wait(double timeout_s);
  void refuse_misconfigured() const;  // throws Error(config) if a device is misconfigured
  const Status& operator[](Sensor s) const { return status_[s]; }
  const SensorClocks& clocks() const { return clocks_; }
  // Returns the counters of the sensor's driver, even after the driver has ended; empty if the
  // sensor is not configured.
  std::vector<Counter> counters(Sensor s) const;
  // Returns true if the predicate holds for every configured device.
  bool all(const std::function<bool(const Status&)>& predicate) const;
  // Describes the state of a device, e.g. "radar serial:/dev/ttyUSB0: faulted: no such file or
  // directory", or names the other program that uses it.
  std::string describe(Sensor s) const;

 private:
  void on_tags(const TagBlock& block) override;
  void on_histogram(HistogramFrame frame) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_firmware_bias(const FirmwareBias& bias) override { next_->on_firmware_bias(bias); }
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;
  // Warns if the streaming device differs from the calibrated device, or from the device that was
  // streaming previously.
  void warn_of_another(Sensor sensor, const DeviceInfo& info);
  std::vector<Sensor> halt();
  Status& status(Sensor s) { return status_[s]; }

  port::Loop& loop_;
  const Config& config_;
  SampleSink* next_;
  std::optional<DeviceLocks> locks_;  // must outlive the drivers
  PerSensor<Status> status_;
  // Serial number of the device; its model if the serial number is unknown.
  PerSensor<std::string> identities_;
  PerSensor<std::unique_ptr<Driver>> drivers_;
  const bool live_;
  SampleCheck samples_;
  TagCheck tags_;
  TagCheck::Output take_tags_;
  SensorClocks clocks_;
  PerSensor<std::vector<Counter>> last_counters_;  // counters of drivers that have ended
};

}  // namespace echofuse::acquire
