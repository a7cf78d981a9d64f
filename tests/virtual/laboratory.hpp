// SPDX-License-Identifier: MIT
// Simulated laboratory and daemon in one process, in virtual time. Simulated devices and drivers
// are connected in memory. Equal options give runs that are equal bit for bit.
#pragma once
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "acquire/run/daemon.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "sim/devices/device.hpp"
#include "wire.hpp"

namespace echofuse::test {

struct LaboratoryOptions {
  std::string folder{};             // folder that contains lab.toml
  std::string name = "laboratory";  // name that is part of all device addresses
  double window_s = 3;
  double hold_s = 600;           // duration of a scene, s
  double signal_photons = 1500;  // number of signal photons in 3 s
  std::uint64_t seed = 1;
  std::vector<sim::Fault> faults{};
  std::string log{};     // log file of the devices; if empty, no log is written
  std::string scenes{};  // list of scenes that replaces the mixed scenes
  bool radar_required = false;
  std::string assignments{};  // additional lines of lab.toml
  std::string scene = "mixed";
  // cfg file in config/radar. If empty, xwr68xx_paper_50cm.cfg is used with four frames per second.
  std::string radar_cfg{};
  unsigned radar_sdk = 5;  // minor version of the radar's SDK, for example 5 for SDK 3.5
  double laser_rate_hz = 4e6;
  std::function<void(sim::Conditions&)> change{};
};

class Laboratory {
 public:
  explicit Laboratory(const LaboratoryOptions& options);
  ~Laboratory();
  Laboratory(const Laboratory&) = delete;
  Laboratory& operator=(const Laboratory&) = delete;

  port::VirtualLoop loop{std::chrono::seconds(1'700'000'000)};
  // Overrides settings. Each assignment has the form "tdc.bins=99".
  void set(std::initializer_list<std::string> assignments, bool with_calibration = true);
  const acquire::Config& config() const;
  bool radar_radiates() const;
  // If `choked` is true, only the first byte of each radar reply reaches the daemon.
  void choke_radar(bool choked);
  // Shifts the camera's field of view sideways in all later frames.
  void turn_camera();
  // Records the number of slots specified in `run`, or until the recording is interrupted. Throws
  // the same errors as record_run().
  ExitCode record(acquire::RunOptions run);
  // Stops the devices and completes the log.
  void close();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::test
