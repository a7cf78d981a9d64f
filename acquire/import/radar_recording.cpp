// SPDX-License-Identifier: MIT
#include "acquire/import/radar_recording.hpp"

#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "acquire/intake/clock_fit.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

constexpr std::size_t chunk_bytes = 4096, max_looked_at = 32 << 10;

// Returns the time by which a subframe is later than if all subframes had the same period, s; 0 if
// its number is damaged.
double delay_s(const radar::RadarProfile& profile, std::uint32_t subframe) {
  const auto& periods_s = profile.subframe_periods_s;
  if (subframe >= periods_s.size()) return 0;
  return std::accumulate(periods_s.begin(), periods_s.begin() + subframe,
                         -static_cast<double>(subframe) * profile.frame_period_s);
}

// Reads the headers of all frames, and fits their times. The fit expects subframes with equal
// periods.
FrameTimes times_of(const std::string& path, const radar::RadarProfile& profile) {
  std::vector<FrameHeader> headers;
  std::vector<double> delays_s;
  const auto add = [&](const RadarFrame& f) {
    delays_s.push_back(delay_s(profile, f.subframe));
    const auto delay = std::llround(delays_s.back() * RadarFrame::clock_hz);
    headers.push_back({f.frame_number * profile.subframes + f.subframe, f.frame_number,
                       f.time_cpu_cycles - static_cast<std::uint32_t>(delay)});
  };
  const RegularFile file(path, ExitCode::failed);
  radar::FrameParser parser(profile.antennas);
  std::array<std::uint8_t, chunk_bytes> chunk;
  while (const std::size_t count = file.read(chunk))
    parser.feed({chunk.data(), count}, HostTime{}, add);
  parser.finish(add);
  const bool unnumbered = lacks_numbers(headers);
  for (std::uint32_t i = 0; unnumbered && i < headers.size(); ++i) headers[i].position += i;
  FrameTimes times = fit_times(headers, profile.subframes, profile.frame_period_s);
  times.unnumbered = unnumbered;
  for (std::size_t i = 0; i < times.at.size(); ++i)
    times.at[i] += from_seconds(delays_s[i] - delays_s[0]);
  return times;
}

}  // namespace

RadarRecording::RadarRecording(const std::string& path, const radar::RadarProfile& profile)
    : path_(path),
      file_(path, ExitCode::failed),
      profile_(profile),
      parser_(profile.antennas),
      times_(times_of(path, profile)) {}

DeviceInfo RadarRecording::device() const {
  DeviceInfo info;
  info.sensor = Sensor::radar;
  info.address = path_;
  info.model = "TI mmWave demo";
  info.axes.push_back(radar::radar_axis(profile_));
  if (!profile_.array.empty()) info.axes.push_back(radar::array_axis(profile_));
  return info;
}

void RadarRecording::take(RadarFrame frame, SampleSink& sink) {
  const std::size_t index = frames_++;
  if (times_.copy.at(index)) return;
  const std::size_t bins = frame.power.size();
  if (bins > 0 && bins != profile_.bins) ++others_, other_bins_ = bins;
  if (const std::string fault = radar::heat_map_fault(profile_, frame); !fault.empty()) {
    if (bad_arrays_++ == 0) array_fault_ = fault;
    frame.array.clear();
  }
  frame.received = at_ = times_.at.at(index);
  frame.lost_before = times_.lost.at(index);
  lost_ += frame.lost_before;
  // Frame numbers repeat after a restart. Adding the number of repetitions makes sure that frames
  // with the same number have different device times.
  epoch_ += frame.frame_number <= std::exchange(number_, frame.frame_number);
  frame.time_cpu_cycles += epoch_;
  frame.subframes = profile_.subframes;
  sink.on_radar(std::move(frame));
}

bool RadarRecording::next(SampleSink& sink) {
  if (ended_) return false;
  const auto on_frame = [&](RadarFrame frame) { take(std::move(frame), sink); };
  std::array<std::uint8_t, chunk_bytes> chunk;
  const std::size_t count = file_.read(chunk);
  const ByteView bytes(chunk.data(), count);
  if (beginning_.size() < max_looked_at)
    beginning_.insert(beginning_.end(), bytes.begin(), bytes.end());
  ended_ = count == 0;
  if (!ended_)
    parser_.feed(bytes, HostTime{}, on_frame);
  else
    parser_.finish(on_frame);
  return true;
}

std::vector<Counter> RadarRecording::counters() const {
  radar::FrameCounts counts = parser_.counts();
  counts.lost_frames = lost_, counts.restarts = times_.restarts.count;
  return radar::counters_of(counts);
}

std::vector<std::string> RadarRecording::doubts() const {
  std::vector<std::string> out;
  const radar::FrameCounts& c = parser_.counts();
  const auto count = [&](std::uint64_t number, const std::string& what) {
    if (number > 0) out.push_back(std::to_string(number) + what);
  };
  const std::uint64_t broken = c.truncated_frames + c.bad_headers + c.bad_tlvs;
  const std::string changed = radar::changed_bytes(beginning_);
  if (c.frames > 0 && !changed.empty() && (broken > 0 || c.range_profiles == 0))
    out.push_back(changed);
  if (c.frames == 0)
    out.push_back("contains no frame of TI's demo: " + radar::cause_of_no_frames(beginning_));
  else if (c.range_profiles == 0)
    out.emplace_back(
        "no frame has a range profile: the third number of guiMonitor was 0 on the board");
  else if (c.range_profiles < c.frames)
    out.push_back(std::to_string(c.frames - c.range_profiles) + " of " + std::to_string(c.frames) +
                  " frames have no range profile");
  count(others_, " frames have " + std::to_string(other_bins_) +
                     " bins, but the number of bins in the cfg is " +
                     std::to_string(profile_.bins) +
                     (other_bins_ == profile_.bins + 4
                          ? "; the TLV lengths include the TLV headers, as in SDK 1"
                          : "; check that the recording was made with this cfg"));
  count(bad_arrays_, " heat maps are unusable: " + array_fault_);
  if (bad_arrays_ == 0 && !profile_.array.empty() && c.frames > 0 && c.arrays == 0)
    out.emplace_back("no frame has a heat map: the fifth number of guiMonitor was 0 on the board");
  for (std::string& text : times_.doubts()) out.push_back(std::move(text));
  count(lost_, " frames are missing");
  if (broken > 0 || c.junk_bytes > 0)
    out.push_back(std::to_string(broken) + " frames are damaged, " + std::to_string(c.junk_bytes) +
                  " bytes belong to no frame");
  count(c.excess_tlvs,
        " frames announce a TLV that they do not contain; their other data are used");
  const double expected_s = profile_.frame_period_s * profile_.subframes;
  const double period_s = times_.period_s > 0 ? profile_.subframes * times_.period_s : expected_s;
  if (std::abs(period_s - expected_s) > 0.05 * expected_s)
    out.push_back(
        format("frame period %.1f ms; expected %.1f ms from the cfg; check that the recording was "
               "made with this cfg",
               1e3 * period_s, 1e3 * expected_s));
  return out;
}

}  // namespace echofuse::acquire
