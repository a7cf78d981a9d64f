// SPDX-License-Identifier: MIT
// A laboratory and a daemon in one process, on virtual time: the simulated devices meet the drivers
// on wires in memory. With the same options the same bytes are written.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/run/daemon.hpp"
#include "drivers/port/virtual_loop.hpp"
#include "sim/devices/device.hpp"
#include "wire.hpp"

namespace echofuse::test {

struct LaboratoryOptions {
  std::string folder{};             // of lab.toml
  std::string name = "laboratory";  // of its devices
  double window_s = 3;
  double hold_s = 600;           // of a scene
  double signal_photons = 1500;  // in 3 s
  std::uint64_t seed = 1;
  std::vector<sim::Fault> faults{};
  std::string log{};     // of what the devices did; empty: none
  std::string scenes{};  // a list of scenes in place of mixed ones
  bool radar_required = false;
  std::string assignments{};  // lines more of lab.toml
};

class Laboratory {
 public:
  explicit Laboratory(const LaboratoryOptions& options);
  ~Laboratory();
  Laboratory(const Laboratory&) = delete;
  Laboratory& operator=(const Laboratory&) = delete;

  port::VirtualLoop loop{std::chrono::seconds(1'700'000'000)};
  // Another value of the configuration: "tdc.bins=99".
  void set(const std::string& assignment);
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
