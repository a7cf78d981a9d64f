// SPDX-License-Identifier: MIT
// A laboratory has a time tagger, a radar and a depth camera that look at the same scenes. They are
// reached as the real ones are. Its directory holds:
//
//   lab.toml                 the daemon's configuration; written last: when it is there, all is
//   radar-cli, radar-data    links to the radar's two serial ports
//   radar.cfg                the chirp configuration that lab.toml names
//   depth.sock               frames for the OpenNI2 driver module
//   openni/                  a private OpenNI2 driver set, for LD_LIBRARY_PATH
//   sent.json                at the end: what each device sent
#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "drivers/port/loop.hpp"
#include "drivers/util/exit_code.hpp"
#include "sim/devices/device.hpp"
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

struct LabTagger {
  std::unique_ptr<Device> device;
  std::string address;  // device key in lab.toml
  // environment variables that a program needs to find the tagger
  std::vector<std::pair<std::string, std::string>> environment{};
};

// default window of TI's demos
inline Conditions with_firmware_window(Conditions c = {}) {
  c.radar_psf = "blackman";
  return c;
}

struct LabOptions {
  std::string dir = "lab";
  SceneSchedule schedule;
  Conditions conditions = with_firmware_window();
  Tagging tagging{.laser_rate_hz = 4e6};  // in the brightest scenes fewer than 1 of 20 pulses give
                                          // a detection
  double window_s = 3;    // window of the daemon; signal and background counts are per window
  std::string radar_cfg;  // empty: the paper's 50 cm profile
  std::string radar_board = "isk";
  std::string faults;  // fault file; empty: no faults
  std::string log;     // log of sent data; empty: no log
  // Creates a time tagger that replaces the one behind the bridge; it receives the faults.
  std::function<LabTagger(port::SystemLoop&, ScenePlayer&, const TdcOptions&)> make_tagger;
};

class Lab {
 public:
  // Starts all devices. Stops the loop when destroyed. Throws Error: usage for a directory that is
  // in use, or neither empty nor a former laboratory; failed or config for other errors.
  Lab(port::SystemLoop& loop, const LabOptions& options);
  ~Lab();
  Lab(const Lab&) = delete;
  Lab& operator=(const Lab&) = delete;

  // Returns the shell command that records from this laboratory.
  std::string daemon_command() const;
  // Returns the environment variables that a program needs to use the devices.
  std::vector<std::pair<std::string, std::string>> environment() const;
  // Serves until `done` returns true (called at least 50 times per second). Then stops all devices,
  // removes links and sockets and writes sent.json.
  void serve(const std::function<bool()>& done);
  // Returns the counts of sent items as a JSON object: device -> {name: count}, and "play" with the
  // time zero.
  std::string sent() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> parts_;
};

// Serves while the command runs. The command has the laboratory's devices in its environment and
// this program's folder on its path; it receives SIGTERM and the first SIGINT. Returns its exit
// code, or 128 + N if signal N ended it. Throws Error(failed) if the command cannot be started.
ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet = false);

}  // namespace echofuse::sim
