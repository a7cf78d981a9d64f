// SPDX-License-Identifier: MIT
// OpenNI2 driver with one depth camera, loaded by the unmodified OpenNI2 library. It reads frames
// from the socket LAB/depth.sock of a laboratory. LAB is derived from the path of the module,
// LAB/openni/OpenNI2/Drivers/MODULE. The camera is present while the laboratory accepts
// connections. Threading: OpenNI calls the driver in threads of the application. A separate thread
// reads the socket.
#include <Driver/OniDriverAPI.h>
#include <dlfcn.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <mutex>
#include <new>
#include <string>
#include <thread>
#include <vector>

#include "sim/devices/depth_wire.hpp"

// ONI_EXPORT_DRIVER uses these two macros of the library XnLib. OpenNI2 contains XnLib but does not
// install its headers.
#define XN_NEW(type, argument) new (std::nothrow) type(argument)
#define XN_DELETE(pointer) delete (pointer)

namespace {

using echofuse::sim::depth_magic;
using echofuse::sim::DepthHeader;
using Pixels = std::vector<OniDepthPixel>;

constexpr char serial[] = "SIM-DEPTH-1";
constexpr int poll_ms = 50;
constexpr auto retry = std::chrono::milliseconds(100);
constexpr int max_hello_polls = 40;

std::string find_socket() {
  Dl_info info{};
  if (dladdr(&serial, &info) == 0 || !info.dli_fname) return {};
  std::string path = info.dli_fname;
  // Relative paths are resolved in the drivers folder, which is the working directory while OpenNI
  // loads drivers.
  if (path[0] != '/') {
    char here[4096];
    if (!getcwd(here, sizeof here)) return {};
    path = std::string(here) + "/" + path;
  }
  for (int up = 0; up < 4; ++up) path.resize(std::min(path.size(), path.rfind('/')));
  return path + "/depth.sock";
}
// Determined while the module is loaded, because the working directory changes afterwards.
const std::string socket_path = find_socket();
// The URI contains the socket path, so that the cameras of several laboratories have different
// URIs.
const std::string uri = "echofuse-sim://" + socket_path;

class DepthStream final : public oni::driver::StreamBase {
 public:
  explicit DepthStream(const DepthHeader& camera) : camera_(camera) {}

  int getRequiredFrameSize() override {
    return static_cast<int>(camera_.width * camera_.height) * 2;
  }
  OniStatus start() override {
    const std::lock_guard lock(mutex_);
    running_ = true;
    return ONI_STATUS_OK;
  }
  void stop() override {
    const std::lock_guard lock(mutex_);
    running_ = false;
  }

  OniBool isPropertySupported(int property) override {
    return with_property(property, [](const auto&) {});
  }
  OniStatus getProperty(int property, void* data, int* size) override {
    OniStatus status = ONI_STATUS_OK;
    const bool known = with_property(property, [&](const auto& value) {
      if (*size < static_cast<int>(sizeof value)) {
        status = ONI_STATUS_BAD_PARAMETER;
        return;
      }
      std::memcpy(data, &value, sizeof value);
      *size = sizeof value;
    });
    return known ? status : ONI_STATUS_NOT_SUPPORTED;
  }
  // Accepts a property only with its current value, because all properties are read-only.
  OniStatus setProperty(int property, const void* data, int size) override {
    bool same = false;
    with_property(property, [&](const auto& value) {
      same = size == static_cast<int>(sizeof value) && std::memcmp(data, &value, sizeof value) == 0;
    });
    return same ? ONI_STATUS_OK : ONI_STATUS_NOT_SUPPORTED;
  }
  // Sends all properties to a recorder. A recording without STRIDE and CROPPING cannot be played
  // back.
  void notifyAllProperties() override {
    for (const int property : {ONI_STREAM_PROPERTY_VIDEO_MODE, ONI_STREAM_PROPERTY_HORIZONTAL_FOV,
                               ONI_STREAM_PROPERTY_VERTICAL_FOV, ONI_STREAM_PROPERTY_MIN_VALUE,
                               ONI_STREAM_PROPERTY_MAX_VALUE, ONI_STREAM_PROPERTY_STRIDE,
                               ONI_STREAM_PROPERTY_CROPPING, ONI_STREAM_PROPERTY_MIRRORING})
      with_property(property, [&](const auto& value) {
        raisePropertyChanged(property, &value, sizeof value);
      });
  }

  void deliver(const DepthHeader& header, const Pixels& pixels) {
    const std::lock_guard lock(mutex_);
    if (!running_ || header.width != camera_.width || header.height != camera_.height) return;
    OniFrame* frame = getServices().acquireFrame();
    if (!frame) return;
    frame->dataSize = getRequiredFrameSize();
    std::memcpy(frame->data, pixels.data(), static_cast<std::size_t>(frame->dataSize));
    if (header.truncated != 0) frame->dataSize /= 2;
    frame->sensorType = ONI_SENSOR_DEPTH;
    frame->timestamp = header.time_us;
    frame->frameIndex = static_cast<int>(header.frame_index);
    frame->width = static_cast<int>(header.width);
    frame->height = static_cast<int>(header.height);
    frame->videoMode = mode();
    frame->croppingEnabled = FALSE;
    frame->cropOriginX = frame->cropOriginY = 0;
    frame->stride = stride();
    raiseNewFrame(frame);
    getServices().releaseFrame(frame);
  }

 private:
  int stride() const { return static_cast<int>(camera_.width) * 2; }
  OniVideoMode mode() const {
    return {ONI_PIXEL_FORMAT_DEPTH_1_MM, static_cast<int>(camera_.width),
            static_cast<int>(camera_.height), static_cast<int>(camera_.fps)};
  }
  // Calls `use` with the value of the property, in the type defined for it by OpenNI. Returns false
  // if the property is not supported.
  template <class Use>
  bool with_property(int property, Use use) const {
    switch (property) {
      case ONI_STREAM_PROPERTY_VIDEO_MODE:
        use(mode());
        return true;
      case ONI_STREAM_PROPERTY_HORIZONTAL_FOV:
        use(camera_.horizontal_fov_rad);
        return true;
      case ONI_STREAM_PROPERTY_VERTICAL_FOV:
        use(camera_.vertical_fov_rad);
        return true;
      case ONI_STREAM_PROPERTY_MIN_VALUE:
        use(0);
        return true;
      case ONI_STREAM_PROPERTY_MAX_VALUE:
        use(10000);
        return true;
      case ONI_STREAM_PROPERTY_STRIDE:
        use(stride());
        return true;
      case ONI_STREAM_PROPERTY_MIRRORING:
        use(OniBool{FALSE});
        return true;
      case ONI_STREAM_PROPERTY_CROPPING:
        use(OniCropping{FALSE, 0, 0, mode().resolutionX, mode().resolutionY});
        return true;
      default:
        return false;
    }
  }

  const DepthHeader camera_;
  std::mutex mutex_;
  bool running_ = false;
};

// Open streams of the camera. The reader thread delivers frames to them.
class Streams {
 public:
  void add(DepthStream* stream) {
    const std::lock_guard lock(mutex_);
    open_.push_back(stream);
  }
  void remove(DepthStream* stream) {
    const std::lock_guard lock(mutex_);
    open_.erase(std::remove(open_.begin(), open_.end(), stream), open_.end());
  }
  void deliver(const DepthHeader& header, const Pixels& pixels) {
    const std::lock_guard lock(mutex_);
    for (DepthStream* stream : open_) stream->deliver(header, pixels);
  }

 private:
  std::mutex mutex_;
  std::vector<DepthStream*> open_;
};

class Camera final : public oni::driver::DeviceBase {
 public:
  Camera(const DepthHeader& camera, Streams& streams) : camera_(camera), streams_(streams) {
    mode_ = {ONI_PIXEL_FORMAT_DEPTH_1_MM, static_cast<int>(camera.width),
             static_cast<int>(camera.height), static_cast<int>(camera.fps)};
    info_ = {ONI_SENSOR_DEPTH, 1, &mode_};
  }
  OniStatus getSensorInfoList(OniSensorInfo** list, int* count) override {
    *list = &info_;
    *count = 1;
    return ONI_STATUS_OK;
  }
  oni::driver::StreamBase* createStream(OniSensorType type) override {
    if (type != ONI_SENSOR_DEPTH) return nullptr;
    auto* stream = new DepthStream(camera_);
    streams_.add(stream);
    return stream;
  }
  void destroyStream(oni::driver::StreamBase* stream) override {
    streams_.remove(static_cast<DepthStream*>(stream));
    delete stream;
  }
  OniBool isPropertySupported(int property) override {
    return property == ONI_DEVICE_PROPERTY_SERIAL_NUMBER;
  }
  OniStatus getProperty(int property, void* data, int* size) override {
    if (property != ONI_DEVICE_PROPERTY_SERIAL_NUMBER) return ONI_STATUS_NOT_SUPPORTED;
    if (*size < static_cast<int>(sizeof serial)) return ONI_STATUS_BAD_PARAMETER;
    std::memcpy(data, serial, sizeof serial);
    *size = sizeof serial;
    return ONI_STATUS_OK;
  }

 private:
  DepthHeader camera_;
  Streams& streams_;
  OniVideoMode mode_{};
  OniSensorInfo info_{};
};

class DepthDriver final : public oni::driver::DriverBase {
 public:
  explicit DepthDriver(OniDriverServices* services) : DriverBase(services) {
    std::strncpy(info_.uri, uri.c_str(), sizeof info_.uri - 1);
    std::strcpy(info_.vendor, "Simulated");
    std::strcpy(info_.name, "Laboratory depth camera");
  }
  OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                       oni::driver::DeviceDisconnectedCallback disconnected,
                       oni::driver::DeviceStateChangedCallback changed, void* cookie) override {
    DriverBase::initialize(connected, disconnected, changed, cookie);
    // Connects here, because applications list the cameras immediately after initialisation.
    connect();
    reader_ = std::thread([this] { run(); });
    return ONI_STATUS_OK;
  }
  void shutdown() override {
    quit_ = true;
    if (reader_.joinable()) reader_.join();
    if (fd_ >= 0) close(fd_);
    fd_ = -1;
  }
  OniStatus tryDevice(const char* expected) override {
    return present_ && expected == uri ? ONI_STATUS_OK : ONI_STATUS_ERROR;
  }
  oni::driver::DeviceBase* deviceOpen(const char* expected, const char*) override {
    const std::lock_guard lock(mutex_);
    if (!present_ || expected != uri) return nullptr;
    return new Camera(camera_, streams_);
  }
  void deviceClose(oni::driver::DeviceBase* device) override { delete device; }

 private:
  void run() {
    while (!quit_) {
      if (fd_ < 0 && !connect())
        std::this_thread::sleep_for(retry);
      else if (!read_frame())
        disconnect();
    }
  }

  bool connect() {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (socket_path.size() >= sizeof address.sun_path) return false;
    std::strcpy(address.sun_path, socket_path.c_str());
    fd_ = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    DepthHeader hello;
    if (::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
        !read_exactly(&hello, sizeof hello, max_hello_polls) || hello.magic != depth_magic) {
      close(fd_);
      fd_ = -1;
      return false;
    }
    {
      const std::lock_guard lock(mutex_);
      camera_ = hello;
    }
    present_ = true;
    deviceConnected(&info_);
    return true;
  }

  void disconnect() {
    close(fd_);
    fd_ = -1;
    if (quit_) return;
    present_ = false;
    deviceDisconnected(&info_);
  }

  bool read_frame() {
    DepthHeader header;
    if (!read_exactly(&header, sizeof header, -1) || header.magic != depth_magic ||
        header.pixel_bytes != header.width * header.height * sizeof(OniDepthPixel))
      return false;
    pixels_.resize(header.pixel_bytes / sizeof(OniDepthPixel));
    if (!read_exactly(pixels_.data(), header.pixel_bytes, -1)) return false;
    streams_.deliver(header, pixels_);
    return true;
  }

  // Reads `size` bytes. Returns false at end of file, on shutdown, or after `patience` consecutive
  // polls without data. If `patience` is -1, the number of polls is unlimited.
  bool read_exactly(void* into, std::size_t size, int patience) {
    auto* place = static_cast<char*>(into);
    for (int waited = 0; size > 0 && !quit_ && waited != patience;) {
      pollfd ready{fd_, POLLIN, 0};
      if (poll(&ready, 1, poll_ms) <= 0) {
        ++waited;
        continue;
      }
      const ssize_t n = read(fd_, place, size);
      if (n <= 0) return false;
      place += n;
      size -= static_cast<std::size_t>(n);
      waited = 0;
    }
    return size == 0;
  }

  OniDeviceInfo info_{};
  Streams streams_;
  std::mutex mutex_;
  DepthHeader camera_;
  std::atomic<bool> present_{false}, quit_{false};
  std::thread reader_;
  int fd_ = -1;
  Pixels pixels_;
};

}  // namespace

ONI_EXPORT_DRIVER(DepthDriver)
