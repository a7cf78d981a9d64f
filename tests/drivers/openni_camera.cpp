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
using test::counter;
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

void camera(const char* command) {
  void* module = dlopen(TEST_CAMERA_MODULE, RTLD_NOW | RTLD_NOLOAD);
  REQUIRE(module);
  reinterpret_cast<void (*)(const char*)>(dlsym(module, "test_camera"))(command);
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
  bool reaches(DeviceState state) {
    return run_until(loop, [&] { return sink.state() == state; });
  }
  // Checks that the depth of each pixel is 1000 + 100 y + 10 x + frame number % 10 in units of 1 /
  // `per_mm` mm, rounded to millimetres.
  void check_pixels(std::uint32_t per_mm = 1) const {
    for (const DepthFrame& f : sink.depth) {
      REQUIRE(f.depth_mm.size() == 48);
      for (std::uint32_t i = 0; i < 48; ++i) {
        const std::uint32_t raw = 1000 + 100 * (i / 8) + 10 * (i % 8) + f.frame_number % 10;
        REQUIRE(f.depth_mm[i] == (raw + per_mm / 2) / per_mm);
      }
    }
  }

  port::SystemLoop loop;
  test::KeepingSink sink;
  OpenNiCamera driver;
};

// Uses OpenNI's recorder to create a recording of `count` frames.
struct Recording {
  explicit Recording(int count) {
    openni::Device device;
    openni::VideoStream stream;
    openni::Recorder recorder;
    REQUIRE(device.open(openni::ANY_DEVICE) == openni::STATUS_OK);
    REQUIRE(stream.create(device, openni::SENSOR_DEPTH) == openni::STATUS_OK);
    REQUIRE(recorder.create(path.c_str()) == openni::STATUS_OK);
    REQUIRE(recorder.attach(stream) == openni::STATUS_OK);
    REQUIRE(recorder.start() == openni::STATUS_OK);
    REQUIRE(stream.start() == openni::STATUS_OK);
    openni::VideoFrameRef frame;
    for (int i = 0; i < count; ++i) REQUIRE(stream.readFrame(&frame) == openni::STATUS_OK);
    stream.stop();
    recorder.stop();
    recorder.destroy();
    frame.release();
    stream.destroy();
    device.close();
    REQUIRE(device.open(path.c_str()) == openni::STATUS_OK);
    REQUIRE(stream.create(device, openni::SENSOR_DEPTH) == openni::STATUS_OK);
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
  const HostTime begin = b.loop.now();
  b.start();
  CHECK(b.sink.state() == DeviceState::connecting);
  REQUIRE(b.frames(20));
  CHECK(b.sink.states == std::vector<DeviceState>{DeviceState::connecting, DeviceState::streaming});
  CHECK(b.sink.info.model == "Test camera");
  CHECK(b.sink.info.serial == "T-1");
  CHECK(b.sink.info.address == "openni:");
  b.check_pixels();
  for (const DepthFrame& f : b.sink.depth) {
    CHECK(f.device_time_us == f.frame_number * 10'000);
    CHECK(f.received > begin);
    CHECK(f.received <= b.loop.now());
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
  REQUIRE(b.reaches(DeviceState::faulted));
  CHECK(b.sink.events ==
        std::vector<std::string>{"the address matches several cameras; expected one of "
                                 "openni:test/camera@1/4, openni:test/camera@1/5"});
  CHECK(b.sink.depth.empty());
  camera("unplug second");
  CHECK(b.frames(3));
}

TEST_CASE("images of a camera that always mirrors are mirrored back") {
  Bench b;
  camera("mirror");
  b.start(5);
  b.check_pixels();
}

TEST_CASE("camera depths in tenths of a millimetre are rounded to millimetres") {
  Bench b;
  camera("tenths");
  b.start(12);
  b.check_pixels(10);
}

TEST_CASE("an OpenNI camera that sends no frames is reopened") {
  Bench b;
  b.start(3);
  camera("stall");
  REQUIRE(b.reaches(DeviceState::faulted));
  CHECK(b.sink.events.at(0) == "the camera sent no complete frame for 3 s");
  camera("run");
  CHECK(b.reaches(DeviceState::streaming));
}

TEST_CASE("a camera mode can be selected, and the error for an unsupported mode lists all modes") {
  SECTION("a camera mode is selected by its image size") {
    Bench b("", {.width = 16, .height = 12});
    b.start(5);
    CHECK(b.sink.info.axes[0].count == 16);
    CHECK(b.sink.info.axes[1].count == 12);
    CHECK(b.sink.info.axes[0].at(15.5) == Approx(std::tan(0.5)));
    const DepthFrame& f = b.sink.depth[4];
    CHECK(f.width == 16);
    REQUIRE(f.depth_mm.size() == 192);
    CHECK(f.depth_mm[191] == 1000 + 1100 + 150 + f.frame_number % 10);
  }
  SECTION("a camera mode is selected by its frame rate") {
    Bench b("", {.fps = 50});
    b.start(2);
    CHECK(b.sink.info.axes[0].count == 16);
  }
  SECTION("a camera that sends raw shifts is switched to millimetres") {
    Bench b;
    camera("shifts");
    b.start(5);
    b.check_pixels();
  }
  SECTION("an unsupported camera mode is refused") {
    Bench b("", {.width = 640});
    b.start();
    REQUIRE(b.reaches(DeviceState::faulted));
    CHECK(b.sink.events.at(0) ==
          "the camera does not support this depth mode; it offers 8 x 6 at 100 (raw), 8 x 6 at "
          "100, 16 "
          "x 12 at 50");
  }
}

TEST_CASE("an unplugged camera is reported, and found again at another USB bus address") {
  Bench b("test/camera@1/4");
  b.start(3);
  camera("unplug");
  REQUIRE(b.reaches(DeviceState::faulted));
  CHECK(b.sink.events.at(0) == "camera disconnected");
  b.loop.run_for(350ms);
  camera("move");
  camera("plug");
  REQUIRE(b.reaches(DeviceState::streaming));
  CHECK(b.frames(b.sink.depth.size() + 3));
  CHECK(counter(b.driver, "connections") == 2);
  CHECK(b.sink.info.address == "openni:test/camera@1/4");
}

TEST_CASE("damaged depth frames are dropped, and lost frames are counted") {
  const auto [name, bad] = GENERATE(table<const char*, bool>(
      {{"cut", true}, {"wide", true}, {"skipped", false}, {"twice", false}}));
  Bench b;
  camera(name);
  b.start(40);
  b.driver.stop();
  std::uint32_t seen = 0, lost = 0, twice = 0, damaged = 0;
  const bool comes_twice = std::string_view(name) == "twice";
  for (std::size_t i = 0; i < b.sink.depth.size(); ++i) {
    const DepthFrame& f = b.sink.depth[i];
    ++seen;
    lost += f.lost_before;
    twice += i > 0 && f.frame_number == b.sink.depth[i - 1].frame_number;
    damaged += f.frame_number % 4 == 0;
  }
  CAPTURE(name, seen, lost, twice, counter(b.driver, "bad_frames"));
  b.check_pixels();
  const auto first = b.sink.depth.front().frame_number, last = b.sink.depth.back().frame_number;
  CHECK(seen + lost - twice == last - first + 1);
  if (bad) CHECK(counter(b.driver, "bad_frames") >= 9);
  if (comes_twice)
    CHECK(twice > 0);
  else
    CHECK(damaged == 0);
  CHECK(counter(b.driver, "connections") == 1);
  camera("well");
}

TEST_CASE("an OpenNI camera is reopened after each of 100 disconnections") {
  Bench b("", {.backoff = port::Backoff(1ms, 4ms)});
  b.start();
  double longest_s = 0;
  for (int i = 0; i < 100; ++i) {
    REQUIRE(b.reaches(DeviceState::streaming));
    camera("unplug");
    REQUIRE(b.reaches(DeviceState::faulted));
    const std::size_t before = b.sink.depth.size();
    const HostTime from = b.loop.now();
    camera("plug");
    REQUIRE(b.frames(before + 1));
    longest_s = std::max(longest_s, seconds(b.loop.now() - from));
  }
  WARN("100 times unplugged: at most " << longest_s << " s from the plug to a frame");
  CHECK(longest_s < 10);
  CHECK(counter(b.driver, "connections") == 101);
}

TEST_CASE(
    "a camera that fails after the first frame of each attempt is retried at growing intervals") {
  Bench b;
  b.start();
  for (int i = 0; i < 5; ++i) {
    const std::size_t before = b.sink.depth.size();
    const HostTime from = b.loop.now();
    REQUIRE(b.frames(before + 1));
    // Attempt i follows a delay of 0.05 s * 2^i, minus the time until the driver notices the
    // failure.
    if (i > 0) CHECK(seconds(b.loop.now() - from) > 0.04 * (1 << i));
    camera("unplug");
    REQUIRE(b.reaches(DeviceState::faulted));
    camera("plug");
  }
}

TEST_CASE("depth frames dropped while the event loop is busy are counted") {
  Bench b;
  b.start(3);
  std::this_thread::sleep_for(300ms);
  const std::size_t before = b.sink.depth.size();
  REQUIRE(b.frames(before + 10));
  CHECK(counter(b.driver, "dropped_frames") > 0);
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
  CHECK(test::counter(b.driver, "frames") == b.sink.depth.size());
  const std::size_t calls = b.sink.calls();
  b.loop.run_for(50ms);
  CHECK(b.sink.calls() == calls);
}

TEST_CASE("an OpenNI recording delivers each frame once and then ends") {
  initialize_openni();
  const Recording recording(30);
  for (const bool paced : {false, true}) {
    Bench b(recording.path, {.paced = paced});
    const auto begin = std::chrono::steady_clock::now();
    b.start();
    REQUIRE(b.reaches(DeviceState::ended));
    const auto took = std::chrono::steady_clock::now() - begin;
    REQUIRE(b.sink.depth.size() == recording.frames);
    for (std::size_t i = 0; i < recording.frames; ++i) CHECK(b.sink.depth[i].frame_number == i + 1);
    CHECK(counter(b.driver, "dropped_frames") == 0);
    const auto span = b.sink.depth.back().device_time_us - b.sink.depth.front().device_time_us;
    if (paced) CHECK(took >= std::chrono::microseconds(span));
  }
}

TEST_CASE("a truncated OpenNI recording is refused without a crash") {
  initialize_openni();
  const Recording recording(30);
  // OpenNI's recorder reserves twice the space that it needs, so only the first half of the file
  // contains frames. A quarter of the file is kept.
  std::filesystem::resize_file(recording.path, std::filesystem::file_size(recording.path) / 4);
  Bench b(recording.path, {.paced = false});
  b.start();
  REQUIRE(b.reaches(DeviceState::faulted));
  CHECK(b.sink.events.at(0) == "cannot open the camera");
  CHECK(b.sink.depth.empty());
}

TEST_CASE("a missing OpenNI recording is reported once and retried") {
  Bench b("/nowhere/at-all.oni");
  b.start();
  REQUIRE(b.reaches(DeviceState::faulted));
  CHECK_THAT(b.sink.events.at(0), Catch::StartsWith("cannot open the camera: "));
  b.loop.run_for(350ms);
  CHECK(b.sink.events.size() == 1);
  CHECK(b.sink.states.size() == 2);
}
