// SPDX-License-Identifier: MIT
// Any depth camera that OpenNI2 knows, or one of its recordings (.oni).
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

// The cameras that OpenNI2's modules see now. Throws Error(device) if there are no modules.
std::vector<OpenNiDevice> list_openni_devices();

struct OpenNiOptions {
  // Recordings are played at their own pace, else as fast as they are taken. Each frame comes once,
  // then the state is `ended`.
  bool paced = true;
  // Mode of a live camera; 0: the camera's own choice.
  std::uint32_t width = 0, height = 0, fps = 0;
  port::Backoff backoff{};
};

// A camera that was named by its place on the bus (VENDOR/PRODUCT@BUS/ADDRESS) and comes back at
// another is found again, if it is the only one of its kind.
// Threading: as every driver. Its own thread talks to OpenNI, copies, and posts to the io context;
// at most 4 frames are on their way, a live camera's further ones are dropped and counted.
// Into `raw`, if any, goes every frame, as a depth block of the bridge protocol.
class OpenNiCamera final : public Driver {
 public:
  // Loads OpenNI's modules; throws Error(device) if there are none.
  OpenNiCamera(port::Loop& loop, std::string address, std::string uri, OpenNiOptions options = {},
               port::RawKeeper* raw = nullptr);
  ~OpenNiCamera() override;  // waits for the thread: a tenth of a second
  void start(SampleSink& sink) override;
  void stop() override;
  bool finished() const override;
  std::vector<Counter> counters() const override;

 private:
  struct Shared;
  class Worker;
  std::shared_ptr<Shared> shared_;
  std::string address_, uri_;
  port::Loop& loop_;
  OpenNiOptions options_;
  port::RawKeeper* raw_;
};

}  // namespace echofuse::depth
