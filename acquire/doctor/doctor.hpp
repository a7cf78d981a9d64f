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

// Folders of the kernel's and udev's files; tests replace them.
struct MachineRoots {
  inventory::Roots devices;
  std::string proc = "/proc", run = "/run", etc = "/etc", lib = "/usr/lib";
};

// Checks attached devices and configured serial ports: permissions of this user, and our udev
// rules. A fault of a configured node is a problem, of another one a warning.
std::vector<Finding> check_permissions(const std::optional<Config>& config,
                                       const MachineRoots& roots);
// ModemManager probes every serial port that is not marked to be ignored.
Finding check_modem_manager(const std::optional<Config>& config, const MachineRoots& roots);
// Compares the kernel's limit for all USB buffers with the time tagger's ring.
Finding check_usb_memory(const std::optional<Config>& config, const MachineRoots& roots);

// Checks the clock by adjtimex(2).
struct KernelClock {
  bool readable = false, synchronised = false;
  double maximal_error_s = 0;
};
KernelClock read_clock();
Finding check_clock(const KernelClock& clock);

// ---- the configured devices, from two seconds of their data

// Collects the samples between begin() and end(), and every complaint since the start.
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
  std::uint64_t histograms = 0;                    // from a detector without tags
  std::vector<std::uint64_t> zone_clicks;          // clicks in them
  std::size_t histogram_counts = 0;                // bins of all zones
  std::map<std::int32_t, std::uint64_t> channels;  // number of time tags per channel
  std::uint64_t radar_frames = 0, radar_lost = 0, profiles = 0, arrays = 0;
  std::vector<std::uint16_t> profile;  // last profile
  std::size_t power_bins = 0;          // bins of a radar behind a bridge
  std::uint64_t depth_frames = 0, depth_lost = 0, pixels = 0, valid_pixels = 0;
  std::optional<DepthFrame> depth;                 // last frame
  PerSensor<std::vector<std::string>> complaints;  // each complaint once

 private:
  tdc::Histogram histogram_;
  TagCounts summed_;  // counts in histograms
  bool running_ = false;
};

// `time_s`: duration of the capture.
Finding spd_finding(const Capture& capture, const Config& config, double time_s);
Finding radar_finding(const Capture& capture, const Config& config, double time_s);
Finding depth_finding(const Capture& capture, const Config& config, double time_s);

// Estimates the bytes of a record from the received samples. A device without samples counts with
// its configured size.
double estimate_record_bytes(const Capture& capture, const Config& config);

struct DoctorOptions {
  std::optional<std::int64_t> count;  // slots of the planned run
  bool json = false;
  MachineRoots roots{};
};

// Prints one line for each check; without a configuration only checks of the machine. Returns the
// exit code of the first problem (devices before disk), or ok.
ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop);

}  // namespace echofuse::acquire
