// SPDX-License-Identifier: MIT
// Depth camera that OpenNI2 supports, or an OpenNI2 recording (.oni).
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "drivers/core/driver.hpp"
#include "drivers/port/backoff.hpp"

namespace echofuse::port {
class Loop;
class RawKeeper;
}  // namespace echofuse::port

namespace echofuse::depth {

struct OpenNiDevice {
  std::string uri, model;
};

// Lists the cameras that OpenNI2's modules detect. Throws Error(device) if there are no modules.
std::vector<OpenNiDevice> list_openni_devices();

struct OpenNiOptions {
  // Plays recordings in real time; false: as fast as frames are processed. Each frame is delivered
  // once, then the state is `ended`.
  bool paced = true;
  // Mode of a live camera; 0: camera's default.
  std::uint32_t width = 0, height = 0, fps = 0;
  port::Backoff backoff{};
};

// Driver of an OpenNI2 camera. A camera with a bus address (VENDOR/PRODUCT@BUS/ADDRESS) that
// reappears at another address is found if it is the only one of its kind.
// Threading: as every driver. An own thread calls OpenNI, copies, and posts to the loop. At most 4
// frames are queued; further frames of a live camera are dropped and counted. With `raw`, every
// frame is stored as a depth block of the bridge protocol.
class OpenNiCamera final : public Driver {
 public:
  // Loads OpenNI's modules; throws Error(device) if there are none.
  OpenNiCamera(port::Loop& loop, std::string address, std::string uri, OpenNiOptions options = {},
               port::RawKeeper* raw = nullptr);
  ~OpenNiCamera() override;  // waits up to 0.1 s for the thread
  void start(SampleSink& sink) override;
  void stop() override;
  bool finished() const override;
  std::vector<Counter> counters() const override;

 private:
  struct Shared;
  class CaptureThread;
  std::shared_ptr<Shared> shared_;
  std::string address_, uri_;
  port::Loop& loop_;
  OpenNiOptions options_;
  port::RawKeeper* raw_;
};

}  // namespace echofuse::depth
