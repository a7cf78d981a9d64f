// SPDX-License-Identifier: MIT
// Input: u8 kind (0 .ptu, 1 .dat), then a recording of another program.
#include <sys/mman.h>
#include <unistd.h>

#include "acquire/import/picoquant.hpp"
#include "acquire/import/radar_recording.hpp"
#include "drivers/util/exit_code.hpp"
#include "fuzz.hpp"

using namespace echofuse::acquire;

namespace {

// Temporary file that is kept in memory and can be opened by its path.
class File {
 public:
  explicit File(ByteView bytes) {
    require(fd_ >= 0 && ::write(fd_, bytes.data(), bytes.size()) == std::ssize(bytes), "a file");
  }
  ~File() { ::close(fd_); }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(fd_); }

 private:
  int fd_ = ::memfd_create("import", 0);
};

struct Sink : SampleSink {
  std::uint64_t tags = 0, frames = 0;
  void on_tags(const TagBlock& block) override {
    require(!block.tags.empty(), "a block has tags");
    tags += block.tags.size();
  }
  void on_radar(RadarFrame) override { ++frames; }
  void on_depth(DepthFrame) override {}
  void on_state(Sensor, DeviceState, const DeviceInfo&) override {}
  void on_event(Sensor, Severity, const std::string&) override {}
};

Sink read(Recording& recording) {
  Sink sink;
  HostTime at = recording.at();
  for (bool more = true; more;) {
    more = recording.next(sink);
    require(recording.at() >= at, "time never decreases");
    at = recording.at();
  }
  for (const std::string& text : recording.doubts())
    require(fuzz::is_printable(text) && text.size() < 1000, "a warning is one line");
  return sink;
}

}  // namespace

void fuzz::run(ByteView input) {
  if (input.empty()) return;
  const ByteView bytes = input.subspan(1);
  const File file(bytes);
  try {
    if (input[0] % 2 == 0) {
      PicoquantTags tags(file.path(), {.start_channel = 0, .click_channel = 1});
      require(read(tags).tags <= bytes.size() / 2, "a record has at most two tags");
    } else {
      radar::RadarProfile profile;
      profile.bins = 64, profile.range_step_m = 0.1, profile.frame_period_s = 0.05;
      RadarRecording frames(file.path(), profile);
      require(read(frames).frames <= bytes.size() / 40, "a frame has a header");
    }
  } catch (const Error& error) {
    require(error.code() == ExitCode::failed, "a fault has the code of a file");
    require(is_printable(error.what()) && std::strlen(error.what()) < 500, "a fault is one line");
  }
}
