// SPDX-License-Identifier: MIT
// OpenNI2 depth stream of a camera or a recording, from open() to destruction.
#pragma once
#include <OpenNI.h>

#include <atomic>
#include <chrono>
#include <string>

#include "drivers/depth/openni_camera.hpp"

namespace echofuse::depth {

// Loads OpenNI2's modules once per process; they are unloaded when the process ends. The call
// temporarily changes the working directory, so call it before other threads use relative paths.
// Throws Error(device).
void initialize_openni();

// Opens and reads one stream; create another object to reopen it. readFrame() blocks forever if the
// camera is unplugged, so it is called only when a frame is available. Never seeks, because
// PlaybackControl::seek() crashes in OpenNI 2.2. Threading: use it on one thread only; OpenNI may
// call onDeviceDisconnected on another thread.
class OpenNiSession final : private openni::OpenNI::DeviceDisconnectedListener {
 public:
  OpenNiSession() = default;
  ~OpenNiSession() override;
  OpenNiSession(const OpenNiSession&) = delete;
  OpenNiSession& operator=(const OpenNiSession&) = delete;

  // `uri`: device URI, file name of a recording, or an empty string to open the only camera.
  // Returns an error message, or an empty string on success.
  std::string open(const std::string& uri, const OpenNiOptions& requested);

  enum class Read { frame, nothing, bad_frame, end, disconnected };
  // Fills all fields of `frame` except `received` and `lost_before`.
  Read read(std::chrono::milliseconds timeout, DepthFrame& frame);

  bool recording() const { return recording_; }
  const DeviceInfo& info() const { return info_; }  // address is empty

 private:
  void onDeviceDisconnected(const openni::DeviceInfo* info) override;
  bool open_device(const std::string& uri);
  std::string open_stream(const OpenNiOptions& requested);
  std::string set_up(const OpenNiOptions& requested);
  std::string choose_mode(const OpenNiOptions& requested);
  void describe(const openni::VideoMode& mode);
  bool convert(const openni::VideoFrameRef& raw, DepthFrame& frame) const;

  openni::Device device_;
  openni::VideoStream stream_;
  DeviceInfo info_;
  std::string uri_;
  std::uint16_t units_per_mm_ = 1;
  bool recording_ = false, mirrored_ = false, listening_ = false;
  // number of frames remaining, if a recording is played frame by frame
  int frames_left_ = 0;
  bool stepped_ = false;
  std::atomic<bool> disconnected_{false};
};

}  // namespace echofuse::depth
