// SPDX-License-Identifier: MIT
// Input: u8 kind (0 .ptu, 1 .dat), then a recording of another program.
#include "acquire/import/picoquant.hpp"
#include "acquire/import/radar_recording.hpp"
#include "files.hpp"

using namespace echofuse::acquire;

namespace {

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
  static const Folder folder;
  folder.write("recording", bytes);
  refused_or_done({ExitCode::failed}, [&] {
    if (input[0] % 2 == 0) {
      PicoquantTags tags(folder / "recording", {.start_channel = 0, .click_channel = 1});
      require(read(tags).tags <= bytes.size() / 2, "a record has at most two tags");
    } else {
      radar::RadarProfile profile;
      profile.bins = 64, profile.range_step_m = 0.1, profile.frame_period_s = 0.05;
      RadarRecording frames(folder / "recording", profile);
      require(read(frames).frames <= bytes.size() / 40, "a frame has a header");
    }
  });
}
