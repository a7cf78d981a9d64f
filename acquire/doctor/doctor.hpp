// SPDX-License-Identifier: MIT
// The `doctor` command: would a run with this configuration on this machine go well?
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

// Folders of the kernel's and udev's files; another root in tests.
struct MachineRoots {
  inventory::Roots devices;
  std::string proc = "/proc", run = "/run", etc = "/etc", lib = "/usr/lib";
};

// Attached devices and configured serial ports: may this user open them, are our udev rules there?
// A node that the configuration names is a problem, another one a warning.
std::vector<Finding> check_permissions(const std::optional<Config>& config,
                                       const MachineRoots& roots);
// ModemManager talks to every serial port that is not marked as none of its business.
Finding check_modem_manager(const std::optional<Config>& config, const MachineRoots& roots);
// The kernel's limit for all USB buffers together against the time tagger's ring.
Finding check_usb_memory(const std::optional<Config>& config, const MachineRoots& roots);

// State of the clock by adjtimex(2).
struct KernelClock {
  bool readable = false, synchronised = false;
  double maximal_error_s = 0;
};
KernelClock read_clock();
Finding check_clock(const KernelClock& clock);

// ---- the configured devices, from two seconds of what they send

// Keeps the samples between begin() and end(), and every complaint since the start.
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
  std::vector<std::uint64_t> zone_clicks;          // in them
  std::size_t histogram_counts = 0;                // bins of all zones
  std::map<std::int32_t, std::uint64_t> channels;  // time tags of each
  std::uint64_t radar_frames = 0, radar_lost = 0, profiles = 0, arrays = 0;
  std::vector<std::uint16_t> profile;  // the last one
  std::size_t power_bins = 0;          // bins of a radar behind a bridge
  std::uint64_t depth_frames = 0, depth_lost = 0, pixels = 0, valid_pixels = 0;
  std::optional<DepthFrame> depth;                 // the last one
  PerSensor<std::vector<std::string>> complaints;  // each once

 private:
  tdc::Histogram histogram_;
  TagCounts summed_;  // in histograms
  bool running_ = false;
};

// `time_s`: how long the capture ran.
Finding judge_spd(const Capture& capture, const Config& config, double time_s);
Finding judge_radar(const Capture& capture, const Config& config, double time_s);
Finding judge_depth(const Capture& capture, const Config& config, double time_s);

// Estimates the bytes of a record from the samples that the devices sent. A device that sent
// nothing counts with its configured size.
double estimate_record_bytes(const Capture& capture, const Config& config);

struct DoctorOptions {
  std::optional<std::int64_t> count;  // slots of the run to come
  bool json = false;
  MachineRoots roots{};
};

// Prints one line for each check; without a configuration those of the machine only. The exit code
// of the first problem: device before disk; ok if there are none.
ExitCode examine(const std::optional<Config>& config, const DoctorOptions& options,
                 port::Loop& loop);

}  // namespace echofuse::acquire
