// SPDX-License-Identifier: MIT
// Camera module for the stock OpenNI2 library, with faults on request. Images have 8 x 6 pixels at
// 100 frames/s, or 16 x 12 pixels at 50 frames/s. Depths are 1000 + 100 y + 10 x + index % 10 in
// the camera's unit. The module runs in the process of the test, which controls it through
// test_camera().
#include <Driver/OniDriverAPI.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <new>
#include <string_view>
#include <thread>

// ONI_EXPORT_DRIVER needs these macros. They are normally defined by XnLib, which is not installed.
#define XN_NEW(type, arg) new (std::nothrow) type(arg)
#define XN_DELETE(p) delete (p)

namespace {

using namespace oni::driver;

constexpr int base_width = 8, base_height = 6;
constexpr const char* uris[] = {"test/camera@1/4", "test/camera@1/5"};
std::atomic<bool> present{true}, stalled{false}, mirrored{false}, tenths{false};
std::atomic<bool> shifts{
    false};  // whether the camera sends raw shifts instead of depth values until a mode is set
std::atomic<int> scale{1}, place{0};
enum class Fault { none, cut, wide, twice, skipped };
std::atomic<Fault> fault{Fault::none};  // fault that affects every fourth frame

OniVideoMode mode_of(int s) {
  const OniPixelFormat format =
      tenths ? ONI_PIXEL_FORMAT_DEPTH_100_UM : ONI_PIXEL_FORMAT_DEPTH_1_MM;
  return {format, base_width * s, base_height * s, 100 / s};
}
OniVideoMode mode() {
  OniVideoMode now = mode_of(scale);
  if (shifts) now.pixelFormat = ONI_PIXEL_FORMAT_SHIFT_9_2;
  return now;
}

class Stream final : public StreamBase {
 public:
  ~Stream() override { halt(); }
  int getRequiredFrameSize() override { return mode().resolutionX * mode().resolutionY * 2; }
  OniStatus setProperty(int id, const void* data, int) override {
    if (id != ONI_STREAM_PROPERTY_VIDEO_MODE) return ONI_STATUS_NOT_SUPPORTED;
    scale = static_cast<const OniVideoMode*>(data)->resolutionX / base_width;
    shifts = false;
    return ONI_STATUS_OK;
  }
  OniStatus start() override {
    running_ = true;
    thread_ = std::thread([this] { run(); });
    return ONI_STATUS_OK;
  }
  void stop() override { halt(); }
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
    switch (id) {
      case ONI_STREAM_PROPERTY_VIDEO_MODE:
        return use(mode());
      case ONI_STREAM_PROPERTY_HORIZONTAL_FOV:
        return use(1.0f);
      case ONI_STREAM_PROPERTY_VERTICAL_FOV:
        return use(0.8f);
      case ONI_STREAM_PROPERTY_MAX_VALUE:
        return use(10'000);
      case ONI_STREAM_PROPERTY_STRIDE:
        return use(mode().resolutionX * 2);
      case ONI_STREAM_PROPERTY_CROPPING:
        return use(OniCropping{FALSE, 0, 0, mode().resolutionX, mode().resolutionY});
      case ONI_STREAM_PROPERTY_MIRRORING:
        return use(OniBool{mirrored});
      default:
        return;
    }
  }
  void halt() {
    running_ = false;
    if (thread_.joinable()) thread_.join();
  }
  void run() {
    const auto period = std::chrono::milliseconds(1000 / mode().fps);
    for (int index = 1; running_; std::this_thread::sleep_for(period)) {
      if (!present || stalled) continue;
      const Fault now = index % 4 == 0 ? fault.load() : Fault::none;
      if (now != Fault::skipped) send(index, now);
      if (now == Fault::twice) {
        std::this_thread::sleep_for(period);
        send(index, now);
      }
      ++index;
    }
  }
  void send(int index, Fault now) {
    OniFrame* frame = getServices().acquireFrame();
    if (!frame) return;
    const int width = mode().resolutionX, height = mode().resolutionY;
    auto* z = static_cast<OniDepthPixel*>(frame->data);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        z[y * width + (mirrored ? width - 1 - x : x)] =
            static_cast<OniDepthPixel>(1000 + 100 * y + 10 * x + index % 10);
    frame->frameIndex = index;
    frame->timestamp = static_cast<std::uint64_t>(index) * 10'000;
    frame->videoMode = mode();
    frame->width = now == Fault::wide ? width + 1 : width;
    frame->height = height;
    frame->stride = width * 2;
    frame->dataSize = now == Fault::cut ? width : width * height * 2;
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
    std::strcpy(info_.uri, uris[0]);
    std::strcpy(info_.vendor, "Test");
    std::strcpy(info_.name, "camera");
    deviceConnected(&info_);
    return ONI_STATUS_OK;
  }
  DeviceBase* deviceOpen(const char* expected, const char*) override {
    return present && std::strcmp(expected, uris[place]) == 0 ? new Camera : nullptr;
  }
  void deviceClose(DeviceBase* device) override { delete device; }
  OniStatus tryDevice(const char*) override { return ONI_STATUS_ERROR; }
  void shutdown() override { self = nullptr; }
  void plug(bool in) {
    if (present.exchange(in) == in) return;
    in ? deviceConnected(&info_) : deviceDisconnected(&info_);
  }
  void plug_second() {
    second_ = info_;
    std::strcpy(second_.uri, uris[1]);
    deviceConnected(&second_);
  }
  void unplug_second() { deviceDisconnected(&second_); }
  void move() {
    place = 1;
    std::strcpy(info_.uri, uris[1]);
  }

  static inline Module* self = nullptr;

 private:
  OniDeviceInfo info_{}, second_{};
};

}  // namespace

extern "C" __attribute__((visibility("default"))) void test_camera(const char* command) {
  const std::string_view what = command;
  if (what == "plug" || what == "unplug") Module::self->plug(what == "plug");
  if (what == "plug second") Module::self->plug_second();
  if (what == "unplug second") Module::self->unplug_second();
  if (what == "stall" || what == "run") stalled = what == "stall";
  if (what == "mirror") mirrored = true;
  if (what == "tenths") tenths = true;
  if (what == "shifts") shifts = true;
  if (what == "move") Module::self->move();
  if (what == "cut") fault = Fault::cut;
  if (what == "wide") fault = Fault::wide;
  if (what == "twice") fault = Fault::twice;
  if (what == "skipped") fault = Fault::skipped;
  if (what == "well") fault = Fault::none;
}

ONI_EXPORT_DRIVER(Module)
