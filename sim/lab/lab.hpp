// SPDX-License-Identifier: MIT
// Simulated laboratory with a time tagger, a radar and a depth camera that observe the same scenes.
// Programs use these devices like real devices. The directory of the laboratory contains:
//
//   lab.toml                 configuration for the daemon; written last, when all devices are ready
//   radar-cli, radar-data    symbolic links to the two serial ports of the radar
//   radar.cfg                chirp configuration, used by lab.toml
//   depth.sock               socket that sends frames to the OpenNI2 driver module
//   openni/                  private copy of OpenNI2, for LD_LIBRARY_PATH
//   sent.json                number of items that each device sent; written at the end
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
  std::string address;  // value of tdc.address in lab.toml
  // Environment variables needed by a program to find the tagger.
  std::vector<std::pair<std::string, std::string>> environment{};
};

// Selects the Blackman window over the chirp, the default of TI's demos, and the leakage of a
// board.
inline Conditions as_board(Conditions c = {}) {
  c.radar_psf = "blackman";
  c.radar_leakage = 0.3;
  return c;
}

struct LabOptions {
  std::string dir = "lab";
  SceneSchedule schedule;
  Conditions conditions = as_board();
  // At this laser rate fewer than 5 % of the pulses yield a detection, even in the brightest
  // scenes.
  Tagging tagging{.laser_rate_hz = 4e6};
  double window_s = 3;    // slot length, s; signal and background counts are per slot
  std::string radar_cfg;  // TI .cfg file; empty: the 50 cm profile of Lai et al. (2024)
  std::string radar_board = "isk";
  std::string faults;  // TOML file of faults; empty: no faults
  std::string log;     // log file of sent data; empty: no log
  // Creates the time tagger. If the function is not set, the tagger uses the bridge protocol.
  // TdcOptions contains the faults.
  std::function<LabTagger(port::SystemLoop&, ScenePlayer&, const TdcOptions&)> make_tagger;
};

class Lab {
 public:
  // Starts all devices. The destructor removes links and sockets. Throws Error(usage) if the
  // laboratory's directory is in use or contains files not created by a laboratory, and
  // Error(failed), Error(config) or Error(disk) for other errors.
  Lab(port::SystemLoop& loop, const LabOptions& options);
  ~Lab();
  Lab(const Lab&) = delete;
  Lab& operator=(const Lab&) = delete;

  // Returns a shell command that records data from this laboratory.
  std::string daemon_command() const;
  // Returns the environment variables needed by a program to use the devices.
  std::vector<std::pair<std::string, std::string>> environment() const;
  // Runs the devices until `done` returns true. `done` is called at least 50 times per second. Then
  // stops all devices, removes links and sockets, and writes sent.json.
  void serve(const std::function<bool()>& done);
  // Returns a JSON object with the number of items sent by each device: {device: {name: count}}.
  // The key "play" contains the schedule of scenes and the host time of its start.
  std::string sent() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> parts_;
};

// Runs the devices while the command runs. The environment of the command gives access to the
// devices, and its PATH includes the folder of this program. If this program is interrupted, the
// command receives SIGTERM. Returns the exit code of the command, or 128 + N if signal N ended it.
// Throws Error(failed) if the command cannot be started.
ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet = false);

}  // namespace echofuse::sim
