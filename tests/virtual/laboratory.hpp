// SPDX-License-Identifier: MIT
// A laboratory and a daemon in one process, on virtual time: the simulated devices meet the drivers
// on wires in memory. With the same options the same bytes are written.
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
  std::string folder{};             // holds lab.toml
  std::string name = "laboratory";  // the devices' own
  double window_s = 3;
  double hold_s = 600;           // time that a scene stays
  double signal_photons = 1500;  // in 3 s
  std::uint64_t seed = 1;
  std::vector<sim::Fault> faults{};
  std::string log{};     // path of the devices' log; empty: none
  std::string scenes{};  // a list of scenes in place of mixed ones
  bool radar_required = false;
  std::string assignments{};  // lines more of lab.toml
  std::string scene = "mixed";
  std::string radar_cfg{};  // one of config/radar; empty: the paper's, at four frames a second
  unsigned radar_sdk = 5;   // the 5 of SDK 3.5
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
  // Other values of the configuration: "tdc.bins=99".
  void set(std::initializer_list<std::string> assignments, bool with_calibration = true);
  const acquire::Config& config() const;
  bool radar_radiates() const;
  // Only the first byte of what it answers comes through.
  void choke_radar(bool choked);
  // From now on the camera's pixels look elsewhere.
  void turn_camera();
  // Records so many slots, or until interrupted. Throws as record_run does.
  ExitCode record(acquire::RunOptions run);
  // The devices end, and what they did is in the log.
  void close();

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace echofuse::test
