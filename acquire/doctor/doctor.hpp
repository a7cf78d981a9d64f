// SPDX-License-Identifier: MIT
// The `doctor` command: checks whether a run with this configuration would succeed on this machine.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/intake/intake.hpp"
#include "acquire/run/disk.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/port/loop.hpp"

namespace echofuse::acquire {

// Folders in which the kernel and udev keep their files; tests use other folders.
struct MachineRoots {
  inventory::Roots devices;
  std::string proc = "/proc", run = "/run", etc = "/etc", lib = "/usr/lib";
};

// Checks whether this user may open the attached devices and the configured serial ports, and
// whether the udev rules of echofuse are installed. A fault of a configured device is graded as a
// problem, a fault of any other device as a warning.
std::vector<Finding> check_permissions(const std::optional<Config>& config,
                                       const MachineRoots& roots);
// Warns if ModemManager is running and would probe a serial port of one of the instrument's
// devices.
Finding check_modem_manager(const std::optional<Config>& config, const MachineRoots& roots);
// Checks that the kernel's limit for USB buffers is large enough for the buffers of the time
// tagger.
Finding check_usb_memory(const std::optional<Config>& config, const MachineRoots& roots);

// Warns if the kernel may suspend the USB device of a configured serial port or of an attached
// device.
Finding check_usb_power(const std::optional<Config>& config, const MachineRoots& roots);
// Warns if this process may open only a few files: a run needs them for its devices and its file.
Finding check_open_files(std::uint64_t limit);
std::uint64_t open_files_limit();
Finding processor_finding();

// State of the system clock, as reported by adjtimex(2).
struct KernelClock {
  bool readable = false, synchronised = false;
  double maximal_error_s = 0;
};
KernelClock read_clock();
Finding check_clock(const KernelClock& clock);

// ---- Checks of the configured devices, based on one slot of their data

// Collects the samples of one slot, as a run does, and all warnings and errors since its
// construction.
class Capture final : public SampleSink {
 public:
  static constexpr double slot_s = 2;
  explicit Capture(const Config& config) : config_(config) {}
  // Begins the slot. `clocks` must outlive this object.
  void begin(HostTime now, const SensorClocks& clocks) {
    intake_.emplace(config_, slot_s, clocks).begin(now);
  }
  void announce(const DeviceInfo& info);
  void end();

  void on_tags(const TagBlock& block) override;
  void on_histogram(HistogramFrame frame) override;
  void on_radar(RadarFrame frame) override { add(frame); }
  void on_depth(DepthFrame frame) override { add(std::move(frame)); }
  void on_state(Sensor sensor, DeviceState state, const DeviceInfo& info) override;
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;

  record::FusedRecord record;  // record of the slot, with the same verdicts as in a run
  std::vector<Axis> axes;      // axes of the devices that have answered
  bool sends_histograms = false;
  double longest_exposure_s = 0;                   // longest exposure time of a histogram
  std::map<std::int32_t, std::uint64_t> channels;  // number of time tags per channel
  PerSensor<std::vector<std::string>> complaints;  // distinct warnings and errors of each sensor

 private:
  template <class Sample>
  void add(Sample&& sample) {
    if (intake_) intake_->slots.add(std::forward<Sample>(sample));
  }
  const Config& config_;
  std::optional<Intake> intake_;
};

Finding spd_finding(const Capture& capture, const Config& config);
Finding radar_finding(const Capture& capture, const Config& config);
Finding depth_finding(const Capture& capture, const Config& config);

// Estimates the size of a record in bytes from the received samples. For a device that sent no
// samples, the configured size is used.
double estimate_record_bytes(const Capture& capture, const Config& config);

struct DoctorOptions {
  std::optional<std::int64_t> count;
  bool json = false;
  MachineRoots roots{};
};

// Runs all checks and prints one line for each. If `config` is empty, only the machine is checked.
// Returns the lowest exit code of all problems, or ExitCode::ok.
ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop);

}  // namespace echofuse::acquire
