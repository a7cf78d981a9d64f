// SPDX-License-Identifier: MIT
#include "acquire/import/radar_recording.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

#include "acquire/stream/clock_fit.hpp"

namespace echofuse::acquire {
namespace {

constexpr double tick_s = 5e-9, wrap_s = 4294967296.0 * tick_s;
constexpr std::size_t chunk_bytes = 4096, most_looked_at = 32 << 10;

std::string fixed(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f", value);
  return text;
}

}  // namespace

RadarRecording::RadarRecording(const std::string& path, const radar::RadarProfile& profile)
    : path_(path), file_(path, ExitCode::failed), profile_(profile), parser_(profile.antennas) {}

DeviceInfo RadarRecording::device() const {
  DeviceInfo info;
  info.sensor = Sensor::radar;
  info.address = path_;
  info.model = "TI mmWave demo";
  info.axes.push_back(radar::radar_axis(profile_));
  if (!profile_.array.empty()) info.axes.push_back(radar::array_axis(profile_));
  return info;
}

void RadarRecording::Irregularity::add(const std::string& place) {
  constexpr std::uint64_t most = 5;
  if (++count <= most + 1) places += (count == 1 ? "" : ", ") + (count <= most ? place : "...");
}

RadarRecording::FrameTime RadarRecording::read(const RadarFrame& frame) const {
  return {frame.frame_number * profile_.subframes + frame.subframe, frame.frame_number,
          frame.time_cpu_cycles};
}

// Determines the time of a frame. After a restart of the board, the frame time is set to one period
// after the previous frame, because the counter does not measure the gap. A frame number is treated
// as corrupted if it is not between the numbers of the previous and the next frame.
void RadarRecording::step(FrameTime now, const FrameTime* next) {
  const std::uint32_t usual = 101 * profile_.subframes, most = profile_.subframes << 20;
  const std::uint32_t to_now = now.position - last_->position;
  const std::uint32_t to_next = next ? next->position - now.position : 0, both = to_now + to_next;
  const bool damaged = next && both > 1 && both <= usual && to_now > both;
  if (damaged) now.position = last_->position + 1;
  const double n = to_now < most && !damaged ? to_now : 1;
  const double more = damaged ? both - 1.0 : to_next <= usual ? to_next : 1;

  const double period_s = profile_.frame_period_s;
  const auto passed_s = [&](const FrameTime& from, const FrameTime& to, double periods) {
    const double expected = periods * period_s / tick_s;
    return tick_s * static_cast<double>(ticks_passed(from.cycles, to.cycles, expected, 32));
  };
  const auto fits = [&](double s, double periods) {
    return s > 0 && std::abs(s - periods * period_s) < 0.1 + period_s / 2;
  };
  double step_s = passed_s(*last_, now, n);
  const double more_s = next ? passed_s(now, *next, more) : 0;
  const double both_s = next ? passed_s(*last_, *next, n + more) : 0;
  const bool right = fits(step_s, n), goes_on = next && fits(more_s, more);
  const bool goes_on_without = next && fits(both_s, n + more);
  const bool even = next && step_s > 0 && std::abs(more_s * n - step_s * more) < 0.05 * step_s;

  const std::string frame = std::to_string(now.frame_number), at = fixed(seconds(last_at_)) + " s";
  const std::string between = "frames " + std::to_string(last_->frame_number) + " and " + frame;
  bool believed = true;
  stood_ += now.cycles == last_->cycles;
  if (next && !damaged && to_now >= most && to_next <= usual) {
    step_s = period_s * profile_.subframes;
    restarts_.add("between " + between + " at " + at);
  } else if (goes_on && !goes_on_without && !confirmed_) {  // the first frame's time is corrupted
    impossible_.add("frame " + std::to_string(last_->frame_number) + " at the start");
    step_s = n * period_s;
  } else if (goes_on_without ? right && goes_on : right || even) {
    steps_ += n, stepped_s_ += step_s;
  } else if (goes_on && !goes_on_without) {
    if (step_s < 0) step_s += wrap_s;
    paused_.add("between " + between + " at " + at + " by " + fixed(step_s) + " s + n x 21.47 s");
  } else {
    believed = false;
    step_s = goes_on_without ? both_s * n / std::max(1.0, n + more) : n * period_s;
    if (next) impossible_.add("frame " + frame + " after " + at);
  }
  confirmed_ = confirmed_ || believed;
  at_ = std::max(at_, last_at_ + from_seconds(step_s));
  if (believed) last_ = now, last_at_ = at_;
}

void RadarRecording::take(std::optional<RadarFrame> next, SampleSink& sink) {
  std::optional<RadarFrame> frame = std::exchange(held_, std::move(next));
  if (!frame) return;
  const FrameTime now = read(*frame), following = held_ ? read(*held_) : now;
  if (last_)
    step(now, held_ ? &following : nullptr);
  else
    last_ = now;
  const std::size_t bins = frame->power.size();
  if (bins > 0 && bins != profile_.bins) ++others_, other_bins_ = bins;
  frame->received = at_;
  // Frame numbers repeat after a restart. Adding the number of restarts makes sure that frames with
  // the same number have different device times.
  epoch_ += frame->frame_number < std::exchange(number_, frame->frame_number);
  frame->time_cpu_cycles += epoch_;
  frame->subframes = profile_.subframes;
  sink.on_radar(std::move(*frame));
}

bool RadarRecording::next(SampleSink& sink) {
  if (ended_) return false;
  const auto on_frame = [&](RadarFrame frame) { take(std::move(frame), sink); };
  std::array<std::uint8_t, chunk_bytes> chunk;
  const std::size_t count = file_.read(chunk);
  const ByteView bytes(chunk.data(), count);
  if (beginning_.size() < most_looked_at)
    beginning_.insert(beginning_.end(), bytes.begin(), bytes.end());
  ended_ = count == 0;
  if (!ended_)
    parser_.feed(bytes, HostTime{}, on_frame);
  else
    parser_.finish(on_frame), take({}, sink);
  return true;
}

std::vector<Counter> RadarRecording::counters() const {
  return radar::counters_of(parser_.counts());
}

std::vector<std::string> RadarRecording::doubts() const {
  std::vector<std::string> out;
  const radar::FrameCounts& c = parser_.counts();
  const auto add = [&](const Irregularity& oddity, const std::string& what,
                       const std::string& then) {
    if (oddity.count > 0)
      out.push_back(std::to_string(oddity.count) + what + " (" + oddity.places + ")" + then);
  };
  if (c.frames == 0)
    out.push_back("contains no frame of TI's demo: " + radar::why_no_frames(beginning_));
  else if (c.range_profiles == 0)
    out.emplace_back(
        "no frame has a range profile: the third number of guiMonitor was 0 on the board");
  else if (c.range_profiles < c.frames)
    out.push_back(std::to_string(c.frames - c.range_profiles) + " of " + std::to_string(c.frames) +
                  " frames have no range profile");
  if (others_ > 0)
    out.push_back(std::to_string(others_) + " frames have " + std::to_string(other_bins_) +
                  " bins, but the number of bins in the cfg is " + std::to_string(profile_.bins) +
                  (other_bins_ == profile_.bins + 4
                       ? "; the TLV lengths include the TLV headers, as in SDK 1"
                       : "; check that the recording was made with this cfg"));
  add(restarts_, " restarts of the board", ": the gaps have unknown length and are omitted");
  add(paused_, " gaps in which the board's clock may have wrapped",
      ": their lengths are ambiguous; the shortest possible ones are used");
  if (2 * stood_ > c.frames)
    out.push_back("the board's clock stopped for " + std::to_string(stood_ + 1) +
                  " frames: their times are computed from the frame numbers and the cfg");
  else
    add(impossible_, " frames have impossible times",
        ": their times are computed from the frame numbers and the cfg");
  if (c.lost_frames > 0) out.push_back(std::to_string(c.lost_frames) + " frames are missing");
  const std::uint64_t broken = c.truncated_frames + c.bad_headers + c.bad_tlvs;
  if (broken > 0 || c.junk_bytes > 0)
    out.push_back(std::to_string(broken) + " frames are damaged, " + std::to_string(c.junk_bytes) +
                  " bytes belong to no frame");
  const double expected_s = profile_.frame_period_s * profile_.subframes;
  const double period_s = steps_ > 0 ? profile_.subframes * stepped_s_ / steps_ : expected_s;
  if (std::abs(period_s - expected_s) > 0.05 * expected_s) {
    char text[120];
    std::snprintf(text, sizeof text,
                  "frame period %.1f ms; expected %.1f ms from the cfg; check that the recording "
                  "was made with this cfg",
                  1e3 * period_s, 1e3 * expected_s);
    out.emplace_back(text);
  }
  return out;
}

}  // namespace echofuse::acquire
