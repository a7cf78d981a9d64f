// SPDX-License-Identifier: MIT
// What a radar's data port sent, as TI's Visualizer records it (.dat) and `run --keep-raw` does.
// The times are those of the board: its cycle counter wraps every 21.47 s, so that a longer gap is
// told by the frame numbers and the cfg's frame period.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/import/recording.hpp"
#include "drivers/program/regular_file.hpp"
#include "drivers/radar/frame_parser.hpp"
#include "drivers/radar/profile.hpp"

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
  void take(RadarFrame frame, SampleSink& sink);
  std::string path_;
  RegularFile file_;
  radar::RadarProfile profile_;
  radar::FrameParser parser_;
  bool ended_ = false;
  std::optional<std::uint32_t> cycles_;  // of the last frame
  std::uint64_t restarts_ = 0;           // at the last frame
  HostTime at_{};
  std::uint64_t steps_ = 0;  // frame numbers that passed
  HostTime stepped_{};       // in this time
};

}  // namespace echofuse::acquire
