// SPDX-License-Identifier: MIT
#include "drivers/depth/openni_session.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <sstream>
#include <thread>

#include "drivers/core/bytes.hpp"
#include "drivers/util/exit_code.hpp"

namespace echofuse::depth {
namespace {

using openni::OpenNI;
using openni::Status;

// Delay between stopping and destroying a recording's stream. The player thread of OpenNI's file
// module (2.2, PlayerDevice::MainLoop) iterates over its streams without a lock and crashes if one
// is destroyed. If no stream is started, this thread polls every 10 ms. A delay of 15 ms ends
// midway between two polls, while the thread sleeps.
constexpr std::chrono::milliseconds player_rest{15};

// Returns the failed action and OpenNI's error message as one line. OpenNI's message contains line
// breaks and tabs.
std::string failure(const char* doing) {
  std::istringstream words(OpenNI::getExtendedError());
  std::string text;
  for (std::string word; words >> word;) text += ' ' + word;
  return std::string(doing) + (text.empty() ? "" : ":" + text);
}

bool is_depth(openni::PixelFormat format) {
  return format == openni::PIXEL_FORMAT_DEPTH_1_MM || format == openni::PIXEL_FORMAT_DEPTH_100_UM;
}

std::string describe_mode(const openni::VideoMode& mode) {
  return std::to_string(mode.getResolutionX()) + " x " + std::to_string(mode.getResolutionY()) +
         " at " + std::to_string(mode.getFps()) + (is_depth(mode.getPixelFormat()) ? "" : " (raw)");
}

// Returns the current URI of a camera that was previously attached at `uri`. The part before "@"
// must match exactly one attached camera; otherwise returns an empty string.
std::string moved(const std::string& uri) {
  const std::size_t at = uri.find('@');
  if (at == uri.npos) return {};
  openni::Array<openni::DeviceInfo> all;
  OpenNI::enumerateDevices(&all);
  std::string found;
  for (int i = 0; i < all.getSize(); ++i) {
    const std::string other = all[i].getUri();
    if (other.compare(0, at + 1, uri, 0, at + 1) != 0) continue;
    if (!found.empty()) return {};
    found = other;
  }
  return found;
}

// Returns an error message if several cameras are attached, because an empty address is then
// ambiguous.
std::string several_cameras() {
  openni::Array<openni::DeviceInfo> all;
  OpenNI::enumerateDevices(&all);
  std::string list;
  int count = 0;
  for (int i = 0; i < all.getSize(); ++i) {
    const std::string uri = all[i].getUri();
    std::error_code none;
    // OpenNI also lists recordings that it has opened
    if (std::filesystem::is_regular_file(uri, none)) continue;
    list += (count++ > 0 ? ", openni:" : "openni:") + uri;
  }
  return count > 1 ? "the address matches several cameras; expected one of " + list : "";
}

// Returns an axis on which pixel i is at tangent (i - (count - 1) / 2) * step.
Axis pixel_axis(const char* name, int count, double field_of_view, double sign) {
  const double step = sign * 2 * std::tan(field_of_view / 2) / count;
  return tangent_axis(name, static_cast<std::uint32_t>(count), -0.5 * (count - 1) * step, step);
}

}  // namespace

void initialize_openni() {
  struct Library {
    Status status = OpenNI::initialize();
    ~Library() {
      if (status == openni::STATUS_OK) OpenNI::shutdown();
    }
  };
  static const Library library;
  if (library.status != openni::STATUS_OK)
    throw Error(ExitCode::device,
                failure("OpenNI2 cannot start (are its camera driver modules installed?)"));
}

OpenNiSession::~OpenNiSession() {
  if (listening_) OpenNI::removeDeviceDisconnectedListener(this);
  if (stream_.isValid()) {
    stream_.stop();
    if (recording_) std::this_thread::sleep_for(player_rest);
    stream_.destroy();
  }
  device_.close();
}

bool OpenNiSession::open_device(const std::string& uri) {
  if (device_.open(uri.empty() ? openni::ANY_DEVICE : uri.c_str()) == openni::STATUS_OK)
    return true;
  const std::string other = moved(uri);
  return !other.empty() && other != uri && device_.open(other.c_str()) == openni::STATUS_OK;
}

std::string OpenNiSession::open(const std::string& uri, const OpenNiOptions& requested) {
  if (uri.empty())
    if (std::string several = several_cameras(); !several.empty()) return several;
  // Returns early, because isFile() and similar calls crash on a device that is not open.
  if (!open_device(uri)) return failure("cannot open the camera");
  uri_ = device_.getDeviceInfo().getUri();
  recording_ = device_.isFile();
  if (!recording_) listening_ = OpenNI::addDeviceDisconnectedListener(this) == openni::STATUS_OK;
  return open_stream(requested);
}

std::string OpenNiSession::open_stream(const OpenNiOptions& requested) {
  if (!device_.hasSensor(openni::SENSOR_DEPTH)) return "the camera has no depth sensor";
  if (stream_.create(device_, openni::SENSOR_DEPTH) != openni::STATUS_OK)
    return failure("cannot create the depth stream");
  std::string wrong = set_up(requested);
  if (wrong.empty() && stream_.start() != openni::STATUS_OK)
    wrong = failure("cannot start the depth stream");
  return wrong;
}

// Keeps the camera's current mode if it matches `requested`; otherwise, sets the first mode that
// matches.
std::string OpenNiSession::choose_mode(const OpenNiOptions& requested) {
  const auto like = [](std::uint32_t expected, int is) {
    return expected == 0 || expected == static_cast<std::uint32_t>(is);
  };
  const auto fits = [&](const openni::VideoMode& mode) {
    return is_depth(mode.getPixelFormat()) && like(requested.width, mode.getResolutionX()) &&
           like(requested.height, mode.getResolutionY()) && like(requested.fps, mode.getFps());
  };
  if (fits(stream_.getVideoMode())) return {};
  const auto& modes = stream_.getSensorInfo().getSupportedVideoModes();
  std::string offered;
  for (int i = 0; i < modes.getSize(); ++i) {
    if (fits(modes[i]))
      return stream_.setVideoMode(modes[i]) == openni::STATUS_OK
                 ? ""
                 : failure("cannot set the depth mode");
    offered += (offered.empty() ? "" : ", ") + describe_mode(modes[i]);
  }
  return "the camera does not support this depth mode; it offers " + offered;
}

std::string OpenNiSession::set_up(const OpenNiOptions& requested) {
  if (recording_) {
    openni::PlaybackControl* playback = device_.getPlaybackControl();
    playback->setRepeatEnabled(false);
    // At speed -1, readFrame() steps to the next frame, so that each frame is delivered once. The
    // length of a recording that was not closed properly is unknown. Such a recording plays in real
    // time and ends when no more frames arrive.
    frames_left_ = playback->getNumberOfFrames(stream_);
    stepped_ = frames_left_ > 0 && playback->setSpeed(-1) == openni::STATUS_OK;
  } else {
    if (std::string wrong = choose_mode(requested); !wrong.empty()) return wrong;
    stream_.setMirroringEnabled(false);
  }
  // if mirroring is still on, convert() reverses each row
  mirrored_ = stream_.getMirroringEnabled();
  const openni::VideoMode mode = stream_.getVideoMode();
  const openni::PixelFormat format = mode.getPixelFormat();
  if (!is_depth(format))
    return "pixel format " + std::to_string(format) +
           " is not supported (expected depth in mm or 0.1 mm)";
  units_per_mm_ = format == openni::PIXEL_FORMAT_DEPTH_100_UM ? 10 : 1;
  const double h = stream_.getHorizontalFieldOfView(), v = stream_.getVerticalFieldOfView();
  if (!(h > 0 && h < 3.1 && v > 0 && v < 3.1))
    return "the camera does not report its field of view";
  for (const int side : {mode.getResolutionX(), mode.getResolutionY()})
    if (side < 1 || side > static_cast<int>(max_depth_side))
      return "frame width or height is " + std::to_string(side) + " pixels (limits 1 to " +
             std::to_string(max_depth_side) + ")";
  describe(mode);
  return {};
}

void OpenNiSession::describe(const openni::VideoMode& mode) {
  const openni::DeviceInfo& device = device_.getDeviceInfo();
  info_.sensor = Sensor::depth;
  info_.model = std::string(device.getVendor()) + " " + device.getName();
  char text[256] = {};
  int size = sizeof text - 1;
  if (device_.getProperty(ONI_DEVICE_PROPERTY_SERIAL_NUMBER, text, &size) == openni::STATUS_OK)
    info_.serial = text;
  char firmware[256] = {};
  size = sizeof firmware - 1;
  if (device_.getProperty(ONI_DEVICE_PROPERTY_FIRMWARE_VERSION, firmware, &size) ==
      openni::STATUS_OK)
    info_.firmware = firmware;
  info_.axes = {pixel_axis("depth_x", mode.getResolutionX(), stream_.getHorizontalFieldOfView(), 1),
                pixel_axis("depth_y", mode.getResolutionY(), stream_.getVerticalFieldOfView(), -1)};
}

OpenNiSession::Read OpenNiSession::read(std::chrono::milliseconds timeout, DepthFrame& frame) {
  if (disconnected_) return Read::disconnected;
  if (stepped_) {
    if (frames_left_-- <= 0) return Read::end;
  } else {
    openni::VideoStream* stream = &stream_;
    int which = -1;
    const Status status =
        OpenNI::waitForAnyStream(&stream, 1, &which, static_cast<int>(timeout.count()));
    if (status == openni::STATUS_TIME_OUT) return Read::nothing;
    if (status != openni::STATUS_OK) return Read::disconnected;
  }
  openni::VideoFrameRef raw;
  if (stream_.readFrame(&raw) != openni::STATUS_OK || !raw.isValid()) return Read::disconnected;
  return convert(raw, frame) ? Read::frame : Read::bad_frame;
}

// Converts an OpenNI frame. Returns false if its size differs from that of the stream's mode.
bool OpenNiSession::convert(const openni::VideoFrameRef& raw, DepthFrame& frame) const {
  const std::uint32_t width = info_.axes[0].count, height = info_.axes[1].count;
  const auto stride = static_cast<std::size_t>(raw.getStrideInBytes());
  const auto size = static_cast<std::size_t>(raw.getDataSize());
  const std::size_t row_bytes = std::size_t{width} * sizeof(std::uint16_t);
  if (static_cast<std::uint32_t>(raw.getWidth()) != width ||
      static_cast<std::uint32_t>(raw.getHeight()) != height || stride < row_bytes ||
      size < stride * (height - 1) + row_bytes)
    return false;
  frame.device_time_us = raw.getTimestamp();
  frame.frame_number = static_cast<std::uint32_t>(raw.getFrameIndex());
  frame.width = width;
  frame.height = height;
  frame.depth_mm.resize(std::size_t{width} * height);
  const auto* bytes = static_cast<const std::uint8_t*>(raw.getData());
  for (std::size_t y = 0; y < height; ++y) {
    std::uint16_t* row = frame.depth_mm.data() + y * width;
    std::memcpy(row, bytes + y * stride, row_bytes);
    if (mirrored_) std::reverse(row, row + width);
  }
  if (units_per_mm_ != 1)
    for (std::uint16_t& z : frame.depth_mm)
      z = static_cast<std::uint16_t>((z + units_per_mm_ / 2) / units_per_mm_);
  return true;
}

void OpenNiSession::onDeviceDisconnected(const openni::DeviceInfo* info) {
  if (uri_ == info->getUri()) disconnected_ = true;
}

std::vector<OpenNiDevice> list_openni_devices() {
  initialize_openni();
  openni::Array<openni::DeviceInfo> found;
  openni::OpenNI::enumerateDevices(&found);
  std::vector<OpenNiDevice> out;
  for (int i = 0; i < found.getSize(); ++i)
    out.push_back(
        {found[i].getUri(), std::string(found[i].getVendor()) + " " + found[i].getName()});
  return out;
}

}  // namespace echofuse::depth
