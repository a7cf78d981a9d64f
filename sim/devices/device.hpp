// SPDX-License-Identifier: MIT
// Simulated devices of a laboratory. Each lives in one loop and never blocks it.
#pragma once
#include <cstdint>
#include <fstream>
#include <initializer_list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "drivers/core/clock.hpp"
#include "drivers/program/exit_code.hpp"
#include "sim/devices/faults.hpp"
#include "sim/devices/photon_source.hpp"
#include "sim/devices/scene_player.hpp"

namespace echofuse::port {
class Loop;
class SystemLoop;
}  // namespace echofuse::port

namespace echofuse::sim {

// The log says what a laboratory really did, one JSON object a line:
//   {"t": host monotonic ns, "device": "tdc", "what": "sent", NAME: NUMBER...}
// sim/README.md lists what each device writes.
class SentLog {
 public:
  using Numbers = std::initializer_list<std::pair<const char*, std::int64_t>>;

  // Throws Error(disk) if the file cannot be made.
  explicit SentLog(const std::string& path) : path_(path), out_(path, std::ios::binary) { check(); }

  void put(HostTime time, const char* device, const char* what, Numbers numbers) {
    out_ << "{\"t\":" << time.count() << ",\"device\":\"" << device << "\",\"what\":\"" << what
         << '"';
    for (const auto& [name, value] : numbers) out_ << ",\"" << name << "\":" << value;
    out_ << "}\n";
  }
  // Closes the file. Throws Error(disk) if not all was written.
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

// The plan holds the faults of the devices, and a log of what the devices do, if there is one.
struct FaultPlan {
  std::vector<Fault> faults;
  SentLog* sent_log = nullptr;
};

class Device {
 public:
  virtual ~Device() = default;
  // Says goodbye if the protocol can; sends under way end within a second.
  virtual void stop() = 0;
  // Returns the counts of what was sent so far, by name.
  virtual std::vector<std::pair<std::string, std::uint64_t>> sent() const = 0;
};

// Time tagger behind the bridge protocol. Serves one client at a time, with a block every tick.
// When the client is slow, the oldest tags are kept and new ones are dropped and counted.
struct TdcOptions {
  Tagging tagging;
  double window_s = 3;
  std::uint64_t seed = 1;
  std::size_t send_queue_bytes = 8 << 20;
  std::chrono::milliseconds tick{5};      // a block is sent as often
  std::chrono::milliseconds longest{20};  // time of the tags in a block
  FaultPlan plan{};
};
std::unique_ptr<Device> make_tdc_bridge(port::Loop& loop, ScenePlayer& player,
                                        const TdcOptions& options,
                                        std::unique_ptr<Listener> listener);

// Detector with zones (spd_zones > 1) behind the bridge protocol: histograms instead of tags.
std::unique_ptr<Device> make_histogram_bridge(port::Loop& loop, ScenePlayer& player,
                                              const TdcOptions& options,
                                              std::unique_ptr<Listener> listener);

// The two UARTs of a radar board are pseudo-terminals, published as symbolic links.
struct RadarOptions {
  std::string cli_link, data_link;
  std::uint64_t seed = 1;
  FaultPlan plan{};
  unsigned sdk = 5;           // the 5 of SDK 3.5
  std::string board = "isk";  // isk, aop, ods
};
std::unique_ptr<Device> make_radar_ptys(port::SystemLoop& loop, ScenePlayer& player,
                                        const RadarOptions& options);

// Depth camera, whose frames go to the OpenNI2 driver module (depth_module.cpp) on a unix socket.
struct DepthOptions {
  std::string socket_path;
  std::uint32_t width = 320, height = 240;
  double fps = 30;
  double half_tangent_x = 0.8, half_tangent_y = 0.6;  // 8/5 of the maps' field of view, and more
  std::uint64_t seed = 1;                             // for its faults
  FaultPlan plan{};
};
std::unique_ptr<Device> make_depth_feed(port::SystemLoop& loop, ScenePlayer& player,
                                        const DepthOptions& options);

}  // namespace echofuse::sim
