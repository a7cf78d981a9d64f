// SPDX-License-Identifier: MIT
// Reads the bytes of a radar's data port, recorded by TI's Visualizer (.dat) or `run --keep-raw`.
// Times are derived from the cycle counter of the board, which wraps every 21.47 s. A step of the
// counter is accepted if the frame number and the cfg, or the counter of the next frame, confirm
// it. Otherwise the step is computed from the frame number and the cfg.
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
    // `position` is the number of the subframe, counted from the start of frame 0.
    std::uint32_t position, frame_number, cycles;
  };
  struct Irregularity {
    std::uint64_t count = 0;
    std::string places;  // positions of the first five occurrences in the recording
    void add(const std::string& place);
  };
  FrameTime read(const RadarFrame& frame) const;
  void step(FrameTime now, const FrameTime* next);
  // Passes the previous frame to the sink, and holds `next` until the frame after it arrives.
  void take(std::optional<RadarFrame> next, SampleSink& sink);
  std::string path_;
  RegularFile file_;
  radar::RadarProfile profile_;
  radar::FrameParser parser_;
  bool ended_ = false;
  Bytes beginning_;                 // first bytes of the file
  std::optional<RadarFrame> held_;  // frame held until the next one confirms its time
  std::optional<FrameTime> last_;   // last frame with an accepted time
  HostTime last_at_{}, at_{};
  Irregularity restarts_, paused_, impossible_;
  bool confirmed_ = false;  // true if a step of the device counter has been accepted
  // Number of later frames that have the same time as the last accepted frame.
  std::uint64_t stood_ = 0;
  std::uint64_t others_ = 0;              // number of frames with a wrong number of bins
  std::size_t other_bins_ = 0;            // last wrong number of bins
  std::uint32_t number_ = 0, epoch_ = 0;  // last frame number; number of restarts of the numbering
  // Totals over the accepted steps: number of frame periods according to the frame numbers, and
  // duration in s according to the board's clock.
  double steps_ = 0, stepped_s_ = 0;
};

}  // namespace echofuse::acquire
