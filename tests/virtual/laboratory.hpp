// SPDX-License-Identifier: MIT
// A laboratory and a daemon in one process, on virtual time: simulated devices and drivers are
// connected in memory. Equal options give bitwise equal runs.
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
  std::string folder{};             // contains lab.toml
  std::string name = "laboratory";  // part of the device names
  double window_s = 3;
  double hold_s = 600;           // duration of a scene
  double signal_photons = 1500;  // in 3 s
  std::uint64_t seed = 1;
  std::vector<sim::Fault> faults{};
  std::string log{};     // log of the devices; empty: none
  std::string scenes{};  // list of scenes instead of mixed ones
  bool radar_required = false;
  std::string assignments{};  // additional lines of lab.toml
  std::string scene = "mixed";
  std::string radar_cfg{};  // file of config/radar; empty: the paper's, at four frames per second
  unsigned radar_sdk = 5;   // minor version: 5 for SDK 3.5
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
  // Overrides a setting: "tdc.bins=99".
  void set(std::initializer_list<std::string> assignments, bool with_calibration = true);
  const acquire::Config& config() const;
  bool radar_radiates() const;
  // Passes only the first byte of each reply.
  void choke_radar(bool choked);
  // Turns the camera's field of view from now on.
  void turn_camera();
  // Records this many slots, or until interrupted. Throws like record_run.
  ExitCode record(acquire::RunOptions run);
  // Stops the devices and completes their log.
  void close();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::test
