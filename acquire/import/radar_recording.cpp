// SPDX-License-Identifier: MIT
#include "acquire/import/radar_recording.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace echofuse::acquire {
namespace {

constexpr double tick_s = 5e-9, wrap_s = 4294967296.0 * tick_s;
constexpr std::size_t chunk_bytes = 4096;

}  // namespace

RadarRecording::RadarRecording(const std::string& path, const radar::RadarProfile& profile)
    : path_(path), file_(path, ExitCode::failed), profile_(profile) {}

DeviceInfo RadarRecording::device() const {
  DeviceInfo info;
  info.sensor = Sensor::radar;
  info.address = path_;
  info.model = "TI mmWave demo";
  info.axes.push_back(radar::radar_axis(profile_));
  if (!profile_.array.empty()) info.axes.push_back(radar::array_axis(profile_));
  return info;
}

// A frame after a restart of the board comes a period after the one before: how long the board was
// away its counter does not tell.
void RadarRecording::take(RadarFrame frame, SampleSink& sink) {
  const double period_s = profile_.frame_period_s * profile_.subframes;
  if (std::exchange(restarts_, parser_.counts().restarts) != parser_.counts().restarts) {
    at_ += from_seconds(period_s);
  } else if (cycles_) {
    const double since_s = tick_s * (frame.time_cpu_cycles - *cycles_);
    const double expected_s = period_s * (1.0 + frame.lost_before);
    const double wraps = std::max(0.0, std::round((expected_s - since_s) / wrap_s));
    const HostTime step = from_seconds(since_s + wraps * wrap_s);
    at_ += step;
    if (frame.subframe == 0) steps_ += 1 + frame.lost_before;
    stepped_ += step;
  }
  cycles_ = frame.time_cpu_cycles;
  frame.received = at_;
  frame.subframes = profile_.subframes;
  sink.on_radar(std::move(frame));
}

bool RadarRecording::next(SampleSink& sink) {
  if (ended_) return false;
  const auto on_frame = [&](RadarFrame frame) { take(std::move(frame), sink); };
  std::array<std::uint8_t, chunk_bytes> chunk;
  const std::size_t count = file_.read(chunk);
  if (count > 0)
    parser_.feed(ByteView(chunk.data(), count), HostTime{}, on_frame);
  else
    parser_.finish(on_frame);
  ended_ = count == 0;
  return true;
}

std::vector<Counter> RadarRecording::counters() const {
  return radar::counters_of(parser_.counts());
}

std::vector<std::string> RadarRecording::doubts() const {
  std::vector<std::string> out;
  const radar::FrameCounts& c = parser_.counts();
  if (c.restarts > 0)
    out.push_back("the board began anew " + std::to_string(c.restarts) +
                  " times; how long it was away is not known and left out");
  if (c.lost_frames > 0) out.push_back(std::to_string(c.lost_frames) + " frames are missing");
  const std::uint64_t broken = c.truncated_frames + c.bad_headers + c.bad_tlvs;
  if (broken > 0 || c.junk_bytes > 0)
    out.push_back(std::to_string(broken) + " frames are broken, " + std::to_string(c.junk_bytes) +
                  " bytes are of none");
  const double expected_s = profile_.frame_period_s * profile_.subframes;
  const double period_s = steps_ > 0 ? seconds(stepped_) / static_cast<double>(steps_) : expected_s;
  if (std::abs(period_s - expected_s) > 0.05 * expected_s) {
    char text[120];
    std::snprintf(text, sizeof text,
                  "a frame came every %.1f ms, the cfg says %.1f ms: is it the recording's cfg?",
                  1e3 * period_s, 1e3 * expected_s);
    out.emplace_back(text);
  }
  return out;
}

}  // namespace echofuse::acquire
