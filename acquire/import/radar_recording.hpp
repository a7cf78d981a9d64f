// SPDX-License-Identifier: MIT
// Reads the bytes of a radar's data port, recorded by TI's Visualizer (.dat) or `run --keep-raw`.
// The file is read twice: once for the times of all frames (frame_times.hpp), once for the frames.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "acquire/import/frame_times.hpp"
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
  void take(RadarFrame frame, SampleSink& sink);
  std::string path_;
  RegularFile file_;
  radar::RadarProfile profile_;
  radar::FrameParser parser_;
  bool ended_ = false;
  Bytes beginning_;  // first bytes of the file
  FrameTimes times_;
  std::size_t frames_ = 0;
  std::uint64_t lost_ = 0;
  HostTime at_{};
  std::uint64_t others_ = 0;              // number of frames with a wrong number of bins
  std::size_t other_bins_ = 0;            // last wrong number of bins
  std::uint64_t bad_arrays_ = 0;          // number of heat maps that do not match the cfg
  std::string array_fault_;               // reason for the first of them
  std::uint32_t number_ = 0, epoch_ = 0;  // last frame number; number of times that it did not rise
};

}  // namespace echofuse::acquire
