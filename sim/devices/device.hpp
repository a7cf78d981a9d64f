// SPDX-License-Identifier: MIT
// Simulated devices of a laboratory. Each device runs in the thread of an event loop and never
// blocks it.
#pragma once
#include <cstdint>
#include <fstream>
#include <initializer_list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "drivers/core/clock.hpp"
#include "drivers/util/exit_code.hpp"
#include "sim/devices/faults.hpp"
#include "sim/devices/photon_source.hpp"
#include "sim/devices/scene_player.hpp"

namespace echofuse::port {
class Loop;
class SystemLoop;
}  // namespace echofuse::port

namespace echofuse::sim {

// Log of the data sent by a laboratory. Each line is a JSON object: {"t": host monotonic ns,
// "device": "tdc", "what": "sent", NAME: NUMBER...} sim/README.md lists the entries of each device.
class SentLog {
 public:
  using Numbers = std::initializer_list<std::pair<const char*, std::int64_t>>;

  // Throws Error(disk) if the file cannot be created.
  explicit SentLog(const std::string& path) : path_(path), out_(path, std::ios::binary) { check(); }

  void put(HostTime time, const char* device, const char* what, Numbers numbers) {
    out_ << "{\"t\":" << time.count() << ",\"device\":\"" << device << "\",\"what\":\"" << what
         << '"';
    for (const auto& [name, value] : numbers) out_ << ",\"" << name << "\":" << value;
    out_ << "}\n";
  }
  // Closes the file. Throws Error(disk) if a write failed.
  void close() {
    out_.close();
    check();
  }

 private:
  void check() {
    if (!out_) throw Error(ExitCode::disk, path_ + ": cannot write the log");
  }

  std::string path_;
  std::ofstream out_;
};

class Listener;

// Faults of all devices, and the log of the sent data (null: no log).
struct FaultPlan {
  std::vector<Fault> faults;
  SentLog* sent_log = nullptr;
};

class Device {
 public:
  virtual ~Device() = default;
  // Ends the service. Sends a goodbye message if the protocol of the device defines one. Writes in
  // progress end within one second.
  virtual void stop() = 0;
  // Returns, for each kind of item, the name of the kind and the number of items sent.
  virtual std::vector<std::pair<std::string, std::uint64_t>> sent() const = 0;
};

// Time tagger that sends tags over the bridge protocol, one block per tick, to one client at a
// time. If the client reads too slowly, queued tags are kept, and new tags are dropped and counted.
struct TdcOptions {
  Tagging tagging;
  double window_s = 3;
  std::uint64_t seed = 1;
  std::size_t send_queue_bytes = 8 << 20;
  std::chrono::milliseconds tick{5};      // time between successive blocks
  std::chrono::milliseconds longest{20};  // maximum time span of the tags in one block
  FaultPlan plan{};
};
std::unique_ptr<Device> make_tdc_bridge(port::Loop& loop, ScenePlayer& player,
                                        const TdcOptions& options,
                                        std::unique_ptr<Listener> listener);

// Single-photon detector with zones (spd_zones > 1) that sends histograms over the bridge protocol.
std::unique_ptr<Device> make_histogram_bridge(port::Loop& loop, ScenePlayer& player,
                                              const TdcOptions& options,
                                              std::unique_ptr<Listener> listener);

// Radar board. Its command and data UARTs are pseudo-terminals; `cli_link` and `data_link` are
// symbolic links to these pseudo-terminals.
struct RadarOptions {
  std::string cli_link, data_link;
  std::uint64_t seed = 1;
  FaultPlan plan{};
  unsigned sdk = 5;           // minor version of the mmWave SDK 3.x: 5 for SDK 3.5
  std::string board = "isk";  // TI board: isk, aop or ods
};
std::unique_ptr<Device> make_radar_ptys(port::SystemLoop& loop, ScenePlayer& player,
                                        const RadarOptions& options);

// Depth camera. Sends its frames over a unix socket to the OpenNI2 driver module
// (depth_module.cpp).
struct DepthOptions {
  std::string socket_path;
  std::uint32_t width = 320, height = 240;
  double fps = 30;
  // Tangents of half the field of view. They must exceed those of the depth maps (default 0.55).
  double half_tangent_x = 0.8, half_tangent_y = 0.6;
  std::uint64_t seed = 1;
  FaultPlan plan{};
};
std::unique_ptr<Device> make_depth_feed(port::SystemLoop& loop, ScenePlayer& player,
                                        const DepthOptions& options);

}  // namespace echofuse::sim
