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
#include "drivers/program/exit_code.hpp"
#include "sim/devices/device.hpp"
#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

struct LabTagger {
  std::unique_ptr<Device> device;
  std::string address;  // the name in lab.toml
  // A program needs these variables in its environment to see the tagger.
  std::vector<std::pair<std::string, std::string>> environment{};
};

// The window of TI's demos; any other is to be asked for.
inline Conditions with_firmware_window(Conditions c = {}) {
  c.radar_psf = "blackman";
  return c;
}

struct LabOptions {
  std::string dir = "lab";
  SceneSchedule schedule;
  Conditions conditions = with_firmware_window();
  Tagging tagging{.laser_rate_hz = 4e6};  // the brightest scenes click less than once in 20 pulses
  double window_s = 3;    // window of the daemon; signal and background counts are per window
  std::string radar_cfg;  // if empty, the paper's 50 cm profile
  std::string radar_board = "isk";
  std::string faults;  // a file of faults; if empty, there are none
  std::string log;     // a file for everything sent; if empty, there is none
  // Makes a time tagger that replaces the one behind the bridge; the maker sets its faults.
  std::function<LabTagger(port::SystemLoop&, ScenePlayer&, const TdcOptions&)> make_tagger;
};

class Lab {
 public:
  // Starts all devices. The loop does not run any more once this is gone. Throws Error: usage for a
  // directory that is not empty and not a former laboratory, or is in use; failed or config for
  // anything else that keeps it from starting.
  Lab(port::SystemLoop& loop, const LabOptions& options);
  ~Lab();
  Lab(const Lab&) = delete;
  Lab& operator=(const Lab&) = delete;

  // Returns the shell command that records from this laboratory.
  std::string daemon_command() const;
  // Returns the environment variables that a program needs to use the devices.
  std::vector<std::pair<std::string, std::string>> environment() const;
  // Serves until `done`, which is asked at least 50 times a second. Then it stops all devices,
  // removes links and sockets and writes sent.json.
  void serve(const std::function<bool()>& done);
  // Returns the counts of what was sent, as a JSON object: device -> {name: count}, and "play" with
  // the time zero.
  std::string sent() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

// Serves while the command runs. The command sees the laboratory's devices and has the programs
// beside this one on its path; it gets SIGTERM and the first SIGINT. Returns its exit code, or 128
// + N if signal N ended it. Throws Error(failed) if the command cannot be started.
ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet = false);

}  // namespace echofuse::sim
