// SPDX-License-Identifier: MIT
// Camera module for the stock OpenNI2 library, with faults on request. Images have 8 x 6 pixels at
// 100 frames/s, or 16 x 12 pixels at 50 frames/s. Depths are 1000 + 100 y + 10 x + index % 10 in
// the camera's unit. The module runs in the process of the test, which controls it through
// test_camera().
#include <Driver/OniDriverAPI.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <mutex>
#include <new>
#include <set>
#include <string>
#include <thread>

// ONI_EXPORT_DRIVER needs these macros. They are normally defined by XnLib, which is not installed.
#define XN_NEW(type, arg) new (std::nothrow) type(arg)
#define XN_DELETE(p) delete (p)

namespace {

using namespace oni::driver;

constexpr int base_width = 8, base_height = 6;
constexpr const char* uris[] = {"test/camera@1/4", "test/camera@1/5"};
std::atomic<bool> attached[2];
std::atomic<int> scale{1};
std::mutex mutex;
// Requests of the test. "shifts": the camera sends raw shifts instead of depth values until a
// mode is set. The faults "cut", "wide", "twice" and "skipped" affect every fourth frame.
std::set<std::string> requested;

void request(const std::string& what, bool on) {
  const std::lock_guard lock(mutex);
  if (on)
    requested.insert(what);
  else
    requested.erase(what);
}
bool is(const std::string& what) {
  const std::lock_guard lock(mutex);
  return requested.contains(what);
}

OniVideoMode mode_of(int s) {
  return {is("tenths") ? ONI_PIXEL_FORMAT_DEPTH_100_UM : ONI_PIXEL_FORMAT_DEPTH_1_MM,
          base_width * s, base_height * s, 100 / s};
}
OniVideoMode mode() {
  OniVideoMode now = mode_of(scale);
  if (is("shifts")) now.pixelFormat = ONI_PIXEL_FORMAT_SHIFT_9_2;
  return now;
}

class Stream final : public StreamBase {
 public:
  ~Stream() override { stop(); }
  int getRequiredFrameSize() override { return mode().resolutionX * mode().resolutionY * 2; }
  OniStatus setProperty(int id, const void* data, int) override {
    if (id != ONI_STREAM_PROPERTY_VIDEO_MODE) return ONI_STATUS_NOT_SUPPORTED;
    scale = static_cast<const OniVideoMode*>(data)->resolutionX / base_width;
    request("shifts", false);
    return ONI_STATUS_OK;
  }
  OniStatus start() override {
    running_ = true;
    thread_ = std::thread([this] { run(); });
    return ONI_STATUS_OK;
  }
  void stop() override {
    running_ = false;
    if (thread_.joinable()) thread_.join();
  }
  OniBool isPropertySupported(int id) override {
    bool known = false;
    property(id, [&](const auto&) { known = true; });
    return known;
  }
  OniStatus getProperty(int id, void* data, int* size) override {
    OniStatus status = ONI_STATUS_NOT_SUPPORTED;
    property(id, [&](const auto& value) {
      std::memcpy(data, &value, sizeof value);
      *size = sizeof value;
      status = ONI_STATUS_OK;
    });
    return status;
  }
  // OpenNI does not play the frames of a recording if the STRIDE and CROPPING properties are
  // missing.
  void notifyAllProperties() override {
    for (const int id :
         {ONI_STREAM_PROPERTY_VIDEO_MODE, ONI_STREAM_PROPERTY_HORIZONTAL_FOV,
          ONI_STREAM_PROPERTY_VERTICAL_FOV, ONI_STREAM_PROPERTY_MAX_VALUE,
          ONI_STREAM_PROPERTY_STRIDE, ONI_STREAM_PROPERTY_CROPPING, ONI_STREAM_PROPERTY_MIRRORING})
      property(id, [&](const auto& value) { raisePropertyChanged(id, &value, sizeof value); });
  }

 private:
  template <class Use>
  static void property(int id, const Use& use) {
    const OniVideoMode now = mode();
    if (id == ONI_STREAM_PROPERTY_VIDEO_MODE) use(now);
    if (id == ONI_STREAM_PROPERTY_HORIZONTAL_FOV) use(1.0f);
    if (id == ONI_STREAM_PROPERTY_VERTICAL_FOV) use(0.8f);
    if (id == ONI_STREAM_PROPERTY_MAX_VALUE) use(10'000);
    if (id == ONI_STREAM_PROPERTY_STRIDE) use(now.resolutionX * 2);
    if (id == ONI_STREAM_PROPERTY_CROPPING)
      use(OniCropping{FALSE, 0, 0, now.resolutionX, now.resolutionY});
    if (id == ONI_STREAM_PROPERTY_MIRRORING) use(OniBool{is("mirror")});
  }
  void run() {
    const auto period = std::chrono::milliseconds(1000 / mode().fps);
    for (int index = 1; running_; std::this_thread::sleep_for(period)) {
      if ((!attached[0] && !attached[1]) || is("stall")) continue;
      const bool faulty = index % 4 == 0;
      if (!faulty || !is("skipped")) send(index, faulty);
      if (faulty && is("twice")) {
        std::this_thread::sleep_for(period);
        send(index, faulty);
      }
      ++index;
    }
  }
  void send(int index, bool faulty) {
    OniFrame* frame = getServices().acquireFrame();
    if (!frame) return;
    frame->videoMode = mode();
    const int width = frame->videoMode.resolutionX, height = frame->videoMode.resolutionY;
    const bool mirrored = is("mirror");
    auto* z = static_cast<OniDepthPixel*>(frame->data);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        z[y * width + (mirrored ? width - 1 - x : x)] =
            static_cast<OniDepthPixel>(1000 + 100 * y + 10 * x + index % 10);
    frame->frameIndex = index;
    frame->timestamp = static_cast<std::uint64_t>(index) * 10'000;
    frame->width = faulty && is("wide") ? width + 1 : width;
    frame->height = height;
    frame->stride = width * 2;
    frame->dataSize = faulty && is("cut") ? width : width * height * 2;
    frame->sensorType = ONI_SENSOR_DEPTH;
    frame->croppingEnabled = FALSE;
    frame->cropOriginX = frame->cropOriginY = 0;
    raiseNewFrame(frame);
    getServices().releaseFrame(frame);
  }

  std::thread thread_;
  std::atomic<bool> running_{false};
};

class Camera final : public DeviceBase {
 public:
  Camera() { scale = 1; }
  OniStatus getSensorInfoList(OniSensorInfo** sensors, int* count) override {
    *sensors = &sensor_;
    *count = 1;
    return ONI_STATUS_OK;
  }
  StreamBase* createStream(OniSensorType type) override {
    return type == ONI_SENSOR_DEPTH ? new Stream : nullptr;
  }
  void destroyStream(StreamBase* stream) override { delete stream; }
  OniStatus getProperty(int id, void* data, int* size) override {
    if (id != ONI_DEVICE_PROPERTY_SERIAL_NUMBER) return ONI_STATUS_NOT_SUPPORTED;
    std::memcpy(data, "T-1", 4);
    *size = 4;
    return ONI_STATUS_OK;
  }

 private:
  OniVideoMode modes_[3] = {
      {ONI_PIXEL_FORMAT_SHIFT_9_2, base_width, base_height, 100}, mode_of(1), mode_of(2)};
  OniSensorInfo sensor_{ONI_SENSOR_DEPTH, 3, modes_};
};

class Module final : public DriverBase {
 public:
  explicit Module(OniDriverServices* services) : DriverBase(services) { self = this; }
  OniStatus initialize(DeviceConnectedCallback connected, DeviceDisconnectedCallback disconnected,
                       DeviceStateChangedCallback changed, void* cookie) override {
    DriverBase::initialize(connected, disconnected, changed, cookie);
    for (std::size_t i = 0; i < 2; ++i) {
      std::strcpy(infos_[i].uri, uris[i]);
      std::strcpy(infos_[i].vendor, "Test");
      std::strcpy(infos_[i].name, "camera");
    }
    plug(0, true);
    return ONI_STATUS_OK;
  }
  DeviceBase* deviceOpen(const char* uri, const char*) override {
    for (std::size_t i = 0; i < 2; ++i)
      if (attached[i] && std::strcmp(uri, uris[i]) == 0) return new Camera;
    return nullptr;
  }
  void deviceClose(DeviceBase* device) override { delete device; }
  OniStatus tryDevice(const char*) override { return ONI_STATUS_ERROR; }
  void shutdown() override { self = nullptr; }
  void plug(std::size_t i, bool in) {
    if (attached[i].exchange(in) == in) return;
    in ? deviceConnected(&infos_[i]) : deviceDisconnected(&infos_[i]);
  }

  static inline Module* self = nullptr;

 private:
  OniDeviceInfo infos_[2] = {};
};

}  // namespace

extern "C" __attribute__((visibility("default"))) void test_camera(const char* command) {
  const std::string what = command;
  if (what == "plug" || what == "unplug") return Module::self->plug(0, what == "plug");
  if (what.ends_with(" second")) return Module::self->plug(1, what == "plug second");
  const bool ends = what.starts_with("end ");
  request(ends ? what.substr(4) : what, !ends);
}

ONI_EXPORT_DRIVER(Module)
