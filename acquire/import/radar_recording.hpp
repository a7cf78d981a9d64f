// SPDX-License-Identifier: MIT
// Reads the bytes of a radar's data port, recorded by TI's Visualizer (.dat) or `run --keep-raw`.
// Times are from the board's cycle counter, which wraps every 21.47 s. A step of the counter is
// used if frame number and cfg, or the next frame's counter, confirm it; otherwise frame number and
// cfg give the step.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/import/recording.hpp"
#include "drivers/radar/frame_parser.hpp"
#include "drivers/radar/profile.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::acquire {

class RadarRecording final : public Recording {
 public:
  RadarRecording(const std::string& path, const radar::RadarProfile& profile);
  DeviceInfo device() const override;
  bool next(SampleSink& sink) override;
  HostTime at() const override { return at_; }
  std::vector<Counter> counters() const override;
  std::vector<std::string> doubts() const override;

 private:
  struct FrameTime {
    std::uint32_t position, frame_number, cycles;  // position: of the subframe, from frame 0 on
  };
  struct Irregularity {
    std::uint64_t count = 0;
    std::string places;  // first five, as text
    void add(const std::string& place);
  };
  FrameTime read(const RadarFrame& frame) const;
  void step(FrameTime now, const FrameTime* next);
  void take(std::optional<RadarFrame> next, SampleSink& sink);  // passes on the previous frame
  std::string path_;
  RegularFile file_;
  radar::RadarProfile profile_;
  radar::FrameParser parser_;
  bool ended_ = false;
  Bytes beginning_;                 // start of the file
  std::optional<RadarFrame> held_;  // until the next frame confirms its time
  std::optional<FrameTime> last_;   // last frame with an accepted time
  HostTime last_at_{}, at_{};
  Irregularity restarts_, paused_, impossible_;
  bool confirmed_ = false;                // a step was accepted
  std::uint64_t stood_ = 0;               // frames with the time of the last accepted one
  std::uint64_t others_ = 0;              // frames with another number of bins
  std::size_t other_bins_ = 0;            // the last of these numbers
  std::uint32_t number_ = 0, epoch_ = 0;  // last frame number; restarts so far
  double steps_ = 0,
         stepped_s_ = 0;  // number of periods by frame number, and their duration by the clock
};

}  // namespace echofuse::acquire
