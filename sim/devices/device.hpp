// SPDX-License-Identifier: MIT
// Simulated devices of a laboratory. Each runs in one loop and never blocks it.
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

// Log of the data that a laboratory sent, one JSON object per line: {"t": host monotonic ns,
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

// Faults of the devices, and the log of sent data (may be null).
struct FaultPlan {
  std::vector<Fault> faults;
  SentLog* sent_log = nullptr;
};

class Device {
 public:
  virtual ~Device() = default;
  // Sends a goodbye if the protocol has one; pending writes end within a second.
  virtual void stop() = 0;
  // Returns the counts of sent items, by name.
  virtual std::vector<std::pair<std::string, std::uint64_t>> sent() const = 0;
};

// Time tagger behind the bridge protocol. Serves one client at a time and sends a block per tick.
// If the client is slow, the oldest tags are kept; new ones are dropped and counted.
struct TdcOptions {
  Tagging tagging;
  double window_s = 3;
  std::uint64_t seed = 1;
  std::size_t send_queue_bytes = 8 << 20;
  std::chrono::milliseconds tick{5};      // interval of the blocks
  std::chrono::milliseconds longest{20};  // longest time span of a block's tags
  FaultPlan plan{};
};
std::unique_ptr<Device> make_tdc_bridge(port::Loop& loop, ScenePlayer& player,
                                        const TdcOptions& options,
                                        std::unique_ptr<Listener> listener);

// Detector with zones (spd_zones > 1) behind the bridge protocol: histograms instead of tags.
std::unique_ptr<Device> make_histogram_bridge(port::Loop& loop, ScenePlayer& player,
                                              const TdcOptions& options,
                                              std::unique_ptr<Listener> listener);

// The two UARTs of a radar board are pseudo-terminals with symbolic links.
struct RadarOptions {
  std::string cli_link, data_link;
  std::uint64_t seed = 1;
  FaultPlan plan{};
  unsigned sdk = 5;           // minor version: 5 is SDK 3.5
  std::string board = "isk";  // isk, aop, ods
};
std::unique_ptr<Device> make_radar_ptys(port::SystemLoop& loop, ScenePlayer& player,
                                        const RadarOptions& options);

// Depth camera; its frames go to the OpenNI2 driver module (depth_module.cpp) through a unix
// socket.
struct DepthOptions {
  std::string socket_path;
  std::uint32_t width = 320, height = 240;
  double fps = 30;
  double half_tangent_x = 0.8, half_tangent_y = 0.6;  // at least 8/5 of the maps' field of view
  std::uint64_t seed = 1;                             // seed of the faults
  FaultPlan plan{};
};
std::unique_ptr<Device> make_depth_feed(port::SystemLoop& loop, ScenePlayer& player,
                                        const DepthOptions& options);

}  // namespace echofuse::sim
