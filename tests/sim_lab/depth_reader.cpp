// SPDX-License-Identifier: MIT
// depth_reader FILE FRAMES PLUG: reads FRAMES frames of the simulated depth camera with the
// unmodified OpenNI2 library, and writes the last frame to FILE. If PLUG is 1, then waits until the
// camera disappears and returns, and reads one more frame. Prints one line per frame.
#include <OpenNI.h>

#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

namespace {

class Plug : public openni::OpenNI::DeviceConnectedListener,
             public openni::OpenNI::DeviceDisconnectedListener {
 public:
  void onDeviceConnected(const openni::DeviceInfo*) override { ++connected; }
  void onDeviceDisconnected(const openni::DeviceInfo*) override { ++disconnected; }
  std::atomic<int> connected{0}, disconnected{0};
};

bool wait_for(const std::atomic<int>& count) {
  for (int i = 0; i < 500 && count == 0; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  return count > 0;
}

bool read_frames(const char* path, int frames) {
  openni::Device device;
  openni::VideoStream stream;
  if (device.open(openni::ANY_DEVICE) != openni::STATUS_OK ||
      stream.create(device, openni::SENSOR_DEPTH) != openni::STATUS_OK ||
      stream.start() != openni::STATUS_OK) {
    std::printf("error %s\n", openni::OpenNI::getExtendedError());
    return false;
  }
  const openni::VideoMode mode = stream.getVideoMode();
  std::printf("mode %d %d %d %d fov %.6f %.6f\n", mode.getResolutionX(), mode.getResolutionY(),
              mode.getFps(), mode.getPixelFormat(), stream.getHorizontalFieldOfView(),
              stream.getVerticalFieldOfView());
  openni::VideoFrameRef frame;
  for (int i = 0; i < frames; ++i) {
    openni::VideoStream* streams[] = {&stream};
    int index = -1;
    if (openni::OpenNI::waitForAnyStream(streams, 1, &index, 2000) != openni::STATUS_OK ||
        stream.readFrame(&frame) != openni::STATUS_OK)
      return false;
    std::printf("index %d time %llu stride %d\n", frame.getFrameIndex(),
                static_cast<unsigned long long>(frame.getTimestamp()), frame.getStrideInBytes());
  }
  std::FILE* file = std::fopen(path, "wb");
  if (!file) return false;
  std::fwrite(frame.getData(), 1, static_cast<std::size_t>(frame.getDataSize()), file);
  std::fclose(file);
  return true;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 || openni::OpenNI::initialize() != openni::STATUS_OK) return 2;
  Plug plug;
  openni::OpenNI::addDeviceConnectedListener(&plug);
  openni::OpenNI::addDeviceDisconnectedListener(&plug);
  bool good = read_frames(argv[1], std::atoi(argv[2]));
  if (good && std::atoi(argv[3]) != 0)
    good = wait_for(plug.disconnected) && wait_for(plug.connected) && read_frames(argv[1], 1);
  openni::OpenNI::removeDeviceConnectedListener(&plug);
  openni::OpenNI::removeDeviceDisconnectedListener(&plug);
  openni::OpenNI::shutdown();
  return good ? 0 : 1;
}
