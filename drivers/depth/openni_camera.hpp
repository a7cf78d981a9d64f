// SPDX-License-Identifier: MIT
// Driver of a depth camera supported by OpenNI2, or of an OpenNI2 recording (.oni).
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

// Lists the cameras that OpenNI2's modules detect. Throws Error(device) if no modules are
// installed.
std::vector<OpenNiDevice> list_openni_devices();

struct OpenNiOptions {
  // For recordings only. True: the recording is played in real time. False: it is played as fast as
  // frames can be processed. In both cases, each frame is delivered once, and the state becomes
  // `ended` after the last frame.
  bool paced = true;
  // Mode of a live camera; 0 selects the camera's default.
  std::uint32_t width = 0, height = 0, fps = 0;
  port::Backoff backoff{};
};

// A camera that was opened by its bus address (VENDOR/PRODUCT@BUS/ADDRESS) may reappear at another
// address. It is found there if it is the only attached camera of its kind. Threading: as described
// for Driver. The driver's own thread calls OpenNI, copies each frame and posts it to the loop. At
// most 4 frames are queued; if the queue is full, new frames from a live camera are dropped and
// counted. If `raw` is set, every frame is also stored as a depth block of the bridge protocol.
class OpenNiCamera final : public Driver {
 public:
  // Loads OpenNI2's modules. Throws Error(device) if no modules are installed.
  OpenNiCamera(port::Loop& loop, const std::string& address, const std::string& uri,
               OpenNiOptions options = {}, port::RawKeeper* raw = nullptr);
  ~OpenNiCamera() override;  // waits up to about 0.1 s for the camera's thread to end
  void start(SampleSink& sink) override;
  void stop() override;
  bool finished() const override;
  std::vector<Counter> counters() const override;

 private:
  class Capture;
  std::shared_ptr<Capture> capture_;
};

}  // namespace echofuse::depth
