// SPDX-License-Identifier: MIT
// The `doctor` command: checks whether a run with this configuration would succeed on this machine.
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/config/config.hpp"
#include "acquire/run/disk.hpp"
#include "drivers/core/driver.hpp"
#include "drivers/inventory/inventory.hpp"
#include "drivers/port/loop.hpp"
#include "drivers/tdc/histogram.hpp"

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
// States the SIMD instructions that the programs use.
Finding processor_finding();

// State of the system clock, as reported by adjtimex(2).
struct KernelClock {
  bool readable = false, synchronised = false;
  double maximal_error_s = 0;
};
KernelClock read_clock();
Finding check_clock(const KernelClock& clock);

// ---- Checks of the configured devices, based on two seconds of their data

// Collects the samples between begin() and end(), and all warnings and errors since its
// construction.
class Capture final : public SampleSink {
 public:
  explicit Capture(const tdc::HistogramSettings& settings) : histogram_(settings) {}
  void begin() { running_ = true; }
  void end();

  void on_tags(const TagBlock& block) override;
  void on_histogram(HistogramFrame frame) override;
  void on_radar(RadarFrame frame) override;
  void on_depth(DepthFrame frame) override;
  void on_event(Sensor sensor, Severity severity, const std::string& text) override;

  TagCounts tags;
  std::uint64_t lost_blocks = 0, lost_tags = 0;
  std::uint64_t histograms = 0;            // number of histograms; 0 if the detector sends tags
  std::vector<std::uint64_t> zone_clicks;  // total number of clicks in each detector zone
  std::size_t histogram_counts = 0;        // total number of bins of all zones in one histogram
  std::map<std::int32_t, std::uint64_t> channels;  // number of time tags per channel
  std::uint64_t radar_frames = 0, radar_lost = 0, profiles = 0, arrays = 0;
  std::vector<float> profile;  // last range profile, linear power
  std::uint64_t depth_frames = 0, depth_lost = 0, pixels = 0, valid_pixels = 0;
  std::optional<DepthFrame> depth;                 // last depth frame
  PerSensor<std::vector<std::string>> complaints;  // distinct warnings and errors of each sensor

 private:
  tdc::Histogram histogram_;
  TagCounts summed_;  // total numbers of pulses and clicks in all received histograms
  bool running_ = false;
};

// Each function checks the captured data of one sensor. `time_s` is the duration of the capture.
Finding spd_finding(const Capture& capture, const Config& config, double time_s);
Finding radar_finding(const Capture& capture, const Config& config, double time_s);
Finding depth_finding(const Capture& capture, const Config& config, double time_s);

// Estimates the size of a record in bytes from the received samples. For a device that sent no
// samples, the configured size is used.
double estimate_record_bytes(const Capture& capture, const Config& config);

struct DoctorOptions {
  std::optional<std::int64_t> count;  // number of slots of the planned run
  bool json = false;
  MachineRoots roots{};
};

// Runs all checks and prints one line for each. If `config` is empty, only the machine is checked.
// Returns the lowest exit code of all problems, or ExitCode::ok.
ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop);

}  // namespace echofuse::acquire
