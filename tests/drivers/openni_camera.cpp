// SPDX-License-Identifier: MIT
// Tests the OpenNI2 driver with the stock library, which loads camera_module.cpp.
#include "drivers/depth/openni_camera.hpp"

#include <OpenNI.h>
#include <dlfcn.h>

#include "../fixtures/folder.hpp"
#include "drivers/depth/openni_session.hpp"
#include "sink.hpp"

using namespace echofuse::depth;
using namespace std::chrono_literals;
using test::run_until;

// Leak detection is off, because OpenNI2 leaks some memory and suppressions cannot match leaks in
// modules that are already unloaded.
extern "C" const char* __asan_default_options() { return "detect_leaks=0"; }
// OpenNI2 is not instrumented, so the thread sanitizer reports false errors for the mutexes in
// OpenNI2.
extern "C" const char* __tsan_default_suppressions() {
  return "mutex:libOpenNI2.so\ndeadlock:libOpenNI2.so\nmutex:libOniFile.so\ndeadlock:libOniFile."
         "so\n";
}

namespace {

void camera(const std::string& command) {
  void* module = dlopen(TEST_CAMERA_MODULE, RTLD_NOW | RTLD_NOLOAD);
  REQUIRE(module);
  reinterpret_cast<void (*)(const char*)>(dlsym(module, "test_camera"))(command.c_str());
  dlclose(module);
}

struct Bench {
  explicit Bench(const std::string& uri = "", OpenNiOptions options = {})
      : driver(loop, "openni:" + uri, uri, options) {}
  bool frames(std::size_t count) {
    return run_until(loop, [&] { return sink.depth.size() >= count; });
  }
  // Starts the driver and waits until it has delivered `count` frames.
  void start(std::size_t count = 0) {
    driver.start(sink);
    REQUIRE(frames(count));
  }
  // Waits for the state. Returns the last event.
  std::string reach(DeviceState state) {
    REQUIRE(run_until(loop, [&] { return sink.state() == state; }));
    return sink.events.empty() ? "" : sink.events.back();
  }
  // Checks that the depth of each pixel is 1000 + 100 y + 10 x + frame number % 10 in units of 1 /
  // `per_mm` mm, rounded to millimetres.
  void check_pixels(std::uint32_t per_mm = 1, std::uint32_t width = 8) const {
    for (const DepthFrame& f : sink.depth) {
      REQUIRE(f.width == width);
      REQUIRE(f.depth_mm.size() == width * width * 3 / 4);
      for (std::uint32_t i = 0; i < f.depth_mm.size(); ++i) {
        const std::uint32_t raw = 1000 + 100 * (i / width) + 10 * (i % width) + f.frame_number % 10;
        REQUIRE(f.depth_mm[i] == (raw + per_mm / 2) / per_mm);
      }
    }
  }
  std::uint64_t count(const char* name) const { return test::counter(driver, name); }

  port::SystemLoop loop;
  test::KeepingSink sink;
  OpenNiCamera driver;
};

// Uses OpenNI's recorder to create a recording of 30 frames.
struct Recording {
  Recording() {
    initialize_openni();
    openni::Device device;
    openni::VideoStream stream;
    openni::Recorder recorder;
    openni::VideoFrameRef frame;
    const auto open = [&](const char* uri) {
      return device.open(uri) == openni::STATUS_OK &&
             stream.create(device, openni::SENSOR_DEPTH) == openni::STATUS_OK;
    };
    REQUIRE(open(openni::ANY_DEVICE));
    REQUIRE(recorder.create(path.c_str()) == openni::STATUS_OK);
    REQUIRE(recorder.attach(stream) == openni::STATUS_OK);
    REQUIRE(recorder.start() == openni::STATUS_OK);
    REQUIRE(stream.start() == openni::STATUS_OK);
    for (int i = 0; i < 30; ++i) REQUIRE(stream.readFrame(&frame) == openni::STATUS_OK);
    stream.stop();
    recorder.stop();
    recorder.destroy();
    frame.release();
    stream.destroy();
    device.close();
    REQUIRE(open(path.c_str()));
    frames = static_cast<std::size_t>(device.getPlaybackControl()->getNumberOfFrames(stream));
    stream.destroy();
    device.close();
    REQUIRE(frames > 10);  // the last frames may be missing on a busy machine
  }
  test::Folder folder;
  std::string path = folder / "a.oni";
  std::size_t frames = 0;
};

}  // namespace

TEST_CASE("the OpenNI driver delivers frames, axes and the name of a camera") {
  Bench b;
  for (const Counter& counter : b.driver.counters()) CHECK(counter.value == 0);
  const HostTime begin = b.loop.now();
  b.start();
  CHECK(b.sink.state() == DeviceState::connecting);
  REQUIRE(b.frames(20));
  CHECK(b.sink.states == std::vector{DeviceState::connecting, DeviceState::streaming});
  CHECK(b.sink.info.model + ", " + b.sink.info.serial + ", " + b.sink.info.address ==
        "Test camera, T-1, openni:");
  b.check_pixels();
  for (const DepthFrame& f : b.sink.depth) {
    CHECK(f.device_time_us == f.frame_number * 10'000);
    CHECK((f.received > begin && f.received <= b.loop.now()));
  }
  // The outer edges of the border pixels are at the limits of the field of view.
  REQUIRE(b.sink.info.axes.size() == 2);
  const Axis& x = b.sink.info.axes[0];
  const Axis& y = b.sink.info.axes[1];
  CHECK(x.at(-0.5) == Approx(-std::tan(0.5)));
  CHECK(x.at(7.5) == Approx(std::tan(0.5)));
  CHECK(y.at(-0.5) == Approx(std::tan(0.4)));
  CHECK(y.at(5.5) == Approx(-std::tan(0.4)));
}

TEST_CASE(
    "if no URI is configured, two attached OpenNI cameras are listed, and neither is opened") {
  initialize_openni();
  camera("plug second");
  Bench b;
  b.start();
  CHECK(b.reach(DeviceState::faulted) ==
        "the address matches several cameras; expected one of openni:test/camera@1/4, "
        "openni:test/camera@1/5");
  CHECK(b.sink.depth.empty());
  camera("unplug second");
  CHECK(b.frames(3));
}

TEST_CASE("mirrored images, tenths of a millimetre and raw shifts are converted to millimetres") {
  const std::string mode = GENERATE("mirror", "tenths", "shifts");
  Bench b;
  camera(mode);
  b.start(12);
  b.check_pixels(mode == "tenths" ? 10 : 1);
  camera("end " + mode);
}

TEST_CASE("an OpenNI camera that sends no frames is reopened") {
  Bench b;
  b.start(3);
  camera("stall");
  CHECK(b.reach(DeviceState::faulted) == "the camera sent no complete frame for 3 s");
  camera("end stall");
  b.reach(DeviceState::streaming);
}

TEST_CASE("a camera mode is selected by its image size or by its frame rate") {
  Bench b("", GENERATE(OpenNiOptions{.width = 16}, OpenNiOptions{.height = 12},
                       OpenNiOptions{.fps = 50}));
  b.start(5);
  CHECK(b.sink.info.axes[0].count == 16);
  CHECK(b.sink.info.axes[1].count == 12);
  CHECK(b.sink.info.axes[0].at(15.5) == Approx(std::tan(0.5)));
  b.check_pixels(1, 16);
}

TEST_CASE("the error for an unsupported camera mode lists all modes") {
  Bench b("", {.width = 640});
  b.start();
  CHECK(b.reach(DeviceState::faulted) ==
        "the camera does not support this depth mode; it offers 8 x 6 at 100 (raw), 8 x 6 at "
        "100, 16 x 12 at 50");
}

TEST_CASE("an unplugged camera is reported, and found again at another USB bus address") {
  Bench b("test/camera@1/4");
  b.start(3);
  camera("unplug");
  CHECK(b.reach(DeviceState::faulted) == "camera disconnected");
  b.loop.run_for(350ms);
  camera("plug second");
  b.reach(DeviceState::streaming);
  CHECK(b.frames(b.sink.depth.size() + 3));
  CHECK(b.count("connections") == 2);
  CHECK(b.sink.info.address == "openni:test/camera@1/4");
  camera("unplug second");
  camera("plug");
}

TEST_CASE("damaged depth frames are dropped, and lost frames are counted") {
  const std::string fault = GENERATE("cut", "wide", "skipped", "twice");
  Bench b;
  camera(fault);
  b.start(40);
  b.driver.stop();
  std::uint32_t lost = 0, twice = 0, damaged = 0, last = 0;
  for (const DepthFrame& f : b.sink.depth) {
    lost += f.lost_before;
    twice += f.frame_number == std::exchange(last, f.frame_number);
    damaged += f.frame_number % 4 == 0;
  }
  CAPTURE(fault, lost, twice, damaged);
  b.check_pixels();
  CHECK(b.sink.depth.size() + lost - twice == last - b.sink.depth[0].frame_number + 1);
  CHECK((b.count("bad_frames") >= 9) == (fault == "cut" || fault == "wide"));
  CHECK((twice > 0) == (fault == "twice"));
  CHECK((damaged > 0) == (fault == "twice"));
  CHECK(b.count("connections") == 1);
  camera("end " + fault);
}

TEST_CASE("an OpenNI camera is reopened after each of 100 disconnections") {
  Bench b("", {.backoff = port::Backoff(1ms, 4ms)});
  b.start();
  double longest_s = 0;
  for (int i = 0; i < 100; ++i) {
    b.reach(DeviceState::streaming);
    camera("unplug");
    b.reach(DeviceState::faulted);
    const std::size_t before = b.sink.depth.size();
    const HostTime from = b.loop.now();
    camera("plug");
    REQUIRE(b.frames(before + 1));
    longest_s = std::max(longest_s, seconds(b.loop.now() - from));
  }
  WARN("100 times unplugged: at most " << longest_s << " s from the plug to a frame");
  CHECK(longest_s < 10);
  CHECK(b.count("connections") == 101);
}

TEST_CASE(
    "a camera that fails after the first frame of each attempt is retried at growing intervals") {
  Bench b;
  b.start();
  for (int i = 0; i < 5; ++i) {
    const HostTime from = b.loop.now();
    REQUIRE(b.frames(b.sink.depth.size() + 1));
    // Attempt i follows a delay of 0.05 s * 2^i, minus the time until the driver notices the
    // failure.
    if (i > 0) CHECK(seconds(b.loop.now() - from) > 0.04 * (1 << i));
    camera("unplug");
    b.reach(DeviceState::faulted);
    camera("plug");
  }
}

TEST_CASE("depth frames dropped while the event loop is busy are counted") {
  Bench b;
  b.start(3);
  std::this_thread::sleep_for(300ms);
  REQUIRE(b.frames(b.sink.depth.size() + 10));
  CHECK(b.count("dropped_frames") > 0);
  for (std::size_t i = 1; i < b.sink.depth.size(); ++i)
    CHECK(b.sink.depth[i].frame_number ==
          b.sink.depth[i - 1].frame_number + 1 + b.sink.depth[i].lost_before);
}

TEST_CASE("stop() ends the OpenNI camera thread within a second, and no event follows") {
  Bench b;
  b.start(3);
  const auto begin = std::chrono::steady_clock::now();
  b.driver.stop();
  REQUIRE(run_until(b.loop, [&] { return b.driver.finished(); }));
  CHECK(std::chrono::steady_clock::now() - begin < 1s);
  CHECK(b.count("frames") == b.sink.depth.size());
  const std::size_t calls = b.sink.calls();
  b.loop.run_for(50ms);
  CHECK(b.sink.calls() == calls);
}

TEST_CASE("an OpenNI recording delivers each frame once and then ends") {
  const Recording recording;
  for (const bool paced : {false, true}) {
    Bench b(recording.path, {.paced = paced});
    const auto begin = std::chrono::steady_clock::now();
    b.start();
    b.reach(DeviceState::ended);
    const auto took = std::chrono::steady_clock::now() - begin;
    REQUIRE(b.sink.depth.size() == recording.frames);
    for (std::size_t i = 0; i < recording.frames; ++i) CHECK(b.sink.depth[i].frame_number == i + 1);
    CHECK(b.count("dropped_frames") == 0);
    const auto span = b.sink.depth.back().device_time_us - b.sink.depth.front().device_time_us;
    if (paced) CHECK(took >= std::chrono::microseconds(span));
  }
}

TEST_CASE("a truncated or missing OpenNI recording is reported once and retried") {
  const Recording recording;
  // OpenNI's recorder reserves twice the space that it needs, so only the first half of the file
  // contains frames. A quarter of the file is kept.
  std::filesystem::resize_file(recording.path, std::filesystem::file_size(recording.path) / 4);
  for (const std::string& path : {recording.path, std::string("/nowhere/at-all.oni")}) {
    Bench b(path, {.paced = false});
    b.start();
    CHECK_THAT(b.reach(DeviceState::faulted), Catch::StartsWith("cannot open the camera"));
    b.loop.run_for(350ms);
    CHECK(b.sink.events.size() == 1);
    CHECK(b.sink.states.size() == 2);
    CHECK(b.sink.depth.empty());
  }
}
