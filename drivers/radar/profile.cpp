// SPDX-License-Identifier: MIT
#include "drivers/radar/profile.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>
#include <sstream>
#include <tuple>

#include "drivers/core/sample.hpp"
#include "drivers/radar/cfg.hpp"
#include "drivers/radar/demo_commands.hpp"
#include "drivers/radar/ramp.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::radar {
namespace {

struct EnabledAntennas {
  std::uint32_t receivers = 0;  // mask of enabled receivers
  // indices of the transmitters, counted from 0, in the order of the frame's chirps
  std::vector<std::uint32_t> transmitters;
  std::uint32_t virtuals() const {
    return static_cast<std::uint32_t>(std::popcount(receivers)) *
           static_cast<std::uint32_t>(transmitters.size());
  }
};

// A frame, or a subframe if `sub` is true:
//   frameCfg <first chirp> <last chirp> <loops> <frames> <period, ms> ...
//   subFrameCfg <number> <forced profile> <first chirp> <chirps> <loops> <burst period, ms>
//     <chirp offset> <bursts> <burst loops> <period, ms>
struct FrameCfg {
  CfgCommand line;
  bool sub = false;

  std::uint32_t first_chirp(const Cfg& cfg) const { return cfg.integer(line, sub ? 3 : 1); }
  std::uint32_t last_chirp(const Cfg& cfg) const {
    return sub ? std::min(first_chirp(cfg) + cfg.integer(line, 4) - 1, 511u) : cfg.integer(line, 2);
  }
  std::uint32_t loops(const Cfg& cfg) const { return cfg.integer(line, sub ? 5 : 3); }
  double chirps(const Cfg& cfg) const {
    return (last_chirp(cfg) - first_chirp(cfg) + 1.0) * loops(cfg);
  }
  double period_s(const Cfg& cfg) const { return 1e-3 * cfg.checked(line, sub ? 10 : 5); }
};

std::vector<FrameCfg> read_frames(const Cfg& cfg) {
  if (!cfg.advanced()) return {{cfg.last("frameCfg")}};
  const auto subframes = cfg.integer(cfg.last("advFrameCfg"), 1);
  std::vector<FrameCfg> frames(subframes);
  for (const CfgCommand& c : cfg.all("subFrameCfg"))
    if (const auto k = cfg.integer(c, 1); k < subframes)
      frames[k] = {c, true};
    else
      cfg.fail(c, "has a number that advFrameCfg, with " + std::to_string(subframes) +
                      " subframes, does not allow");
  for (std::size_t k = 0; k < frames.size(); ++k)
    if (!frames[k].sub)
      cfg.fail(cfg.last("advFrameCfg"), "has no subFrameCfg " + std::to_string(k));
  return frames;
}

// Returns the commands that define the frame's chirps, in order; nullptr for a chirp without a
// command. As in the firmware, a command counts only if all its chirps belong to the frame, and the
// last one for a chirp applies. Source: SDK, mmwdemo_rfparser.c.
std::vector<const CfgCommand*> chirps_of(const Cfg& cfg, const FrameCfg& frame) {
  const auto first = frame.first_chirp(cfg), last = frame.last_chirp(cfg);
  constexpr std::uint32_t max_chirps = 32;  // size of an array in the demo
  if (last >= first + max_chirps)
    cfg.fail(frame.line, "uses more than 32 chirps (limit of the demo)");
  std::vector<const CfgCommand*> out(last - first + 1);
  for (const CfgCommand& chirp : cfg.all("chirpCfg")) {
    const auto begin = cfg.integer(chirp, 1), end = cfg.integer(chirp, 2);
    if (begin >= first && end <= last)
      std::fill(out.begin() + (begin - first), out.begin() + (end - first + 1), &chirp);
  }
  return out;
}

// Returns the antennas that the frame uses.
EnabledAntennas read_antennas(const Cfg& cfg, const FrameCfg& frame) {
  const CfgCommand& channels = cfg.last("channelCfg");
  EnabledAntennas out{cfg.integer(channels, 1), {}};
  for (const CfgCommand* chirp : chirps_of(cfg, frame)) {
    const auto mask = chirp ? cfg.integer(*chirp, 8) & cfg.integer(channels, 2) : 0;
    for (std::uint32_t t = 0; t < 3; ++t)
      if (mask >> t & 1 && std::ranges::count(out.transmitters, t) == 0)
        out.transmitters.push_back(t);
  }
  if (out.transmitters.empty()) cfg.fail(frame.line, "uses no chirp with an enabled transmitter");
  return out;
}

// Parameters that determine the range axis.
struct RampSampling {
  std::uint32_t samples = 0;
  double slope_mhz_us = 0, rate_ksps = 0;  // slope rounded to the chip's step
  bool operator==(const RampSampling&) const = default;
};

// Returns the command that defines the chirp's profile, or nullptr. If there are several, returns
// the last one, like the firmware.
const CfgCommand* profile_cfg_of(const Cfg& cfg, const CfgCommand& chirp) {
  const CfgCommand* found = nullptr;
  for (const CfgCommand& c : cfg.all("profileCfg"))
    if (cfg.number(c, 1) == cfg.number(chirp, 3)) found = &c;
  return found;
}

// Returns the profile of the frame's chirps, which determines the range axis.
const CfgCommand& profile_of(const Cfg& cfg, const FrameCfg& frame) {
  for (const CfgCommand* chirp : chirps_of(cfg, frame))
    if (const CfgCommand* found = chirp ? profile_cfg_of(cfg, *chirp) : nullptr) return *found;
  return cfg.last("profileCfg");
}

RampSampling sampling_of(const Cfg& cfg, const CfgCommand& chirp) {
  RampSampling out;
  cfg.attempt([&] { out.samples = cfg.integer(chirp, 10); });
  cfg.attempt([&] {
    out.slope_mhz_us = Ramp{.slope_mhz_us = cfg.checked(chirp, 8)}.in_steps().slope_mhz_us;
  });
  cfg.attempt([&] { out.rate_ksps = cfg.checked(chirp, 11); });
  return out;
}

Ramp ramp_of(const Cfg& cfg, const CfgCommand& profile) {
  const auto n = [&](std::size_t i) { return cfg.number(profile, i); };
  return {n(2), n(3), n(4), n(5), n(8), n(10), n(11)};
}

// Returns the ramp of a chirp. The four middle values are added to those of the profile:
//   chirpCfg <first> <last> <profile> <start, Hz> <slope, kHz/us> <idle, us> <ADC start, us> <tx>
Ramp ramp_of(const Cfg& cfg, const CfgCommand& profile, const CfgCommand& chirp) {
  Ramp ramp = ramp_of(cfg, profile);
  ramp.start_ghz += 1e-9 * cfg.number(chirp, 4);
  ramp.slope_mhz_us += 1e-3 * cfg.number(chirp, 5);
  ramp.idle_us += cfg.number(chirp, 6);
  ramp.adc_start_us += cfg.number(chirp, 7);
  return ramp;
}

// Returns the total duration of the idle times and ramps of a frame's chirps, s.
double active_s(const Cfg& cfg, const FrameCfg& frame) {
  double sum_us = 0;
  for (const CfgCommand* chirp : chirps_of(cfg, frame)) {
    const CfgCommand* own = chirp ? profile_cfg_of(cfg, *chirp) : nullptr;
    const Ramp ramp = own ? ramp_of(cfg, *own, *chirp) : ramp_of(cfg, profile_of(cfg, frame));
    sum_us += ramp.idle_us + ramp.end_us;
  }
  return 1e-6 * frame.loops(cfg) * sum_us;
}

// Returns the number of range bins. Source: SDK, mmwdemo_rfparser.c and mss_main.c.
std::uint32_t bins_of(std::uint32_t samples, std::uint32_t antennas) {
  const std::uint32_t fft = std::bit_ceil(samples);
  return fft == 1024 && antennas == 12 ? 1022 : fft;
}

// Checks all profiles and chirps, because the front end also checks unused ones.
void check_ramps(const Cfg& cfg) {
  // Maximum sample rate, ksps, for a bandwidth of 10 MHz: twice as high for complex 2x (format 2).
  constexpr double fastest = 12500;
  const bool once = cfg.has("adcCfg") && cfg.number(cfg.last("adcCfg"), 2) == 1;
  const double limit = once ? fastest : 2 * fastest;
  for (const CfgCommand& profile : cfg.all("profileCfg")) {
    for (const auto& words : refusals_of(ramp_of(cfg, profile))) cfg.refuse(profile, words);
    if (cfg.number(profile, 11) > limit)
      cfg.refuse(profile, "samples faster than 12500 ksps (25000 with complex 2x, adcCfg 2 2)");
  }
  for (const CfgCommand& chirp : cfg.all("chirpCfg")) {
    const CfgCommand* profile = profile_cfg_of(cfg, chirp);
    if (profile && refusals_of(ramp_of(cfg, *profile)).empty())
      for (const auto& words : refusals_of(ramp_of(cfg, *profile, chirp))) cfg.refuse(chirp, words);
  }
}

// Checks the frame's chirps. The firmware uses one profile for all of them, and separates the
// transmitters of a chirp only with BPM.
void check_chirps(const Cfg& cfg, const FrameCfg& frame) {
  const std::vector<const CfgCommand*> chirps = chirps_of(cfg, frame);
  const auto enabled = cfg.integer(cfg.last("channelCfg"), 2);
  const bool bpm = cfg.has("bpmCfg") && cfg.number(cfg.last("bpmCfg"), 2) != 0;
  const CfgCommand& used = profile_of(cfg, frame);
  for (std::size_t k = 0; k < chirps.size(); ++k) {
    if (!chirps[k]) {
      const std::string number = std::to_string(frame.first_chirp(cfg) + k);
      return cfg.refuse(frame.line,
                        "uses chirp " + number + ", which no chirpCfg of this frame defines");
    }
    const CfgCommand& chirp = *chirps[k];
    const auto mask = cfg.integer(chirp, 8);
    if ((mask & enabled) == 0) cfg.refuse(chirp, "enables no transmitter of channelCfg");
    if (!bpm && std::popcount(mask & enabled) > 1)
      cfg.fail(chirp,
               "enables several transmitters; echofuse supports this only with BPM (bpmCfg)");
    const CfgCommand* own = profile_cfg_of(cfg, chirp);
    if (own && cfg.number(*own, 1) != cfg.number(used, 1))
      cfg.fail(chirp, "uses profileCfg " + std::string(chirp.words[3]) +
                          ", but the first chirp of the frame uses " + std::string(used.words[1]) +
                          "; the demo supports one profile per frame");
  }
}

void check_frame(const Cfg& cfg, const FrameCfg& frame) {
  const double active_ms = 1e3 * active_s(cfg, frame), period_ms = 1e3 * frame.period_s(cfg);
  if (active_ms >= period_ms)
    cfg.refuse(frame.line, "has " + digits(frame.chirps(cfg)) + " chirps, which take " +
                               digits(active_ms) + " ms, but its period is " + digits(period_ms) +
                               " ms");
  const EnabledAntennas antennas = read_antennas(cfg, frame);
  const auto loops = static_cast<std::uint32_t>(frame.chirps(cfg)) /
                     static_cast<std::uint32_t>(antennas.transmitters.size());
  const double bytes = frame_memory_bytes(
      bins_of(sampling_of(cfg, profile_of(cfg, frame)).samples, antennas.virtuals()),
      antennas.virtuals(), loops);
  if (bytes > radar_memory_bytes)
    cfg.refuse(frame.line, "needs " + digits(bytes / 1024) +
                               " KiB for the radar cube and the detection matrix; "
                               "the chip has 768 KiB");
}

// Requires all subframes to have the same range axis and antennas, because a record is the mean of
// all subframes.
void require_equal_subframes(const Cfg& cfg, const std::vector<FrameCfg>& frames) {
  const auto of = [&](const FrameCfg& f) {
    const EnabledAntennas antennas = read_antennas(cfg, f);
    return std::tuple(sampling_of(cfg, profile_of(cfg, f)), antennas.receivers,
                      antennas.transmitters);
  };
  for (const FrameCfg& f : frames)
    if (of(f) != of(frames.front()))
      cfg.fail(f.line,
               "has a different range axis or different antennas than subframe 0; a record is "
               "the mean of all subframes");
  const CfgCommand& gui = cfg.last("guiMonitor");
  for (unsigned k = 0; k < frames.size(); ++k)
    if (const CfgCommand* own = cfg.of_subframe("guiMonitor", k);
        own && !std::equal(own->words.begin() + 2, own->words.end(), gui.words.begin() + 2,
                           gui.words.end()))
      cfg.fail(*own,
               "requests other data than the last guiMonitor; a record is the mean of all "
               "subframes");
}

void read_gui_monitor(const Cfg& cfg, RadarProfile& profile) {
  const CfgCommand& gui = cfg.last("guiMonitor");
  profile.range_profile_on = cfg.number(gui, 3) != 0;
  if (!profile.range_profile_on)
    profile.warnings.push_back(
        cfg.where(gui.line) + "guiMonitor does not send the range profile (its third number is 0)");
}

void read_heat_map(const Cfg& cfg, const EnabledAntennas& antennas, Board board,
                   RadarProfile& profile) {
  if (cfg.number(cfg.last("guiMonitor"), 5) == 0) return;
  profile.planar = is_planar(board);
  profile.pairs = heat_map_pairs(board, antennas.transmitters, antennas.receivers);
  profile.array = heat_map_antennas(board, antennas.transmitters, antennas.receivers);
  const bool in_row = std::ranges::all_of(
      profile.array, [&](const AntennaPlace& a) { return a.y == profile.array[0].y; });
  if (!profile.planar && antennas.transmitters.size() > 1 && std::popcount(antennas.receivers) < 4)
    profile.warnings.push_back(
        cfg.where(cfg.last("channelCfg").line) +
        "channelCfg has fewer than 4 receivers: the heat map of SDK 3.4 then "
        "mixes neighbouring bins");
  if (profile.planar || in_row) return;
  profile.warnings.push_back(cfg.where(cfg.last("chirpCfg").line) +
                             "chirpCfg uses transmitter 2 before 3: the heat map uses the frame's "
                             "first transmitters, which are not in one row");
}

// Returns the packet size for the outputs that guiMonitor enables. Source: SDK,
// MmwDemo_transmitProcessedOutput.
std::uint32_t frame_bytes(const Cfg& cfg, const RadarProfile& profile, std::uint32_t loops) {
  const std::uint32_t bins = profile.bins;
  const auto samples = static_cast<std::uint32_t>(profile.array.size()) * bins;
  const CfgCommand& gui = cfg.last("guiMonitor");
  const std::uint32_t doppler_bins = std::bit_ceil(loops);
  const auto on = [&](std::size_t flag) { return cfg.number(gui, flag) != 0; };
  // bytes; sizes as in frame_parser.cpp
  constexpr std::uint32_t header = 40, tlv = 8, unit = 32;
  std::uint32_t bytes = header;
  if (on(2)) bytes += tlv;                            // header of the point list, without points
  if (on(3)) bytes += tlv + 2 * bins;                 // range profile
  if (on(4)) bytes += tlv + 2 * bins;                 // noise profile
  if (on(5)) bytes += tlv + 4 * samples;              // heat map
  if (on(6)) bytes += tlv + 2 * bins * doppler_bins;  // range-Doppler heat map
  if (on(7)) bytes += tlv + 24 + tlv + 28;            // stats and temperature
  return (bytes + unit - 1) / unit * unit;
}

std::string milliseconds(double s) {
  std::ostringstream text;
  text << std::round(s * 1e4) / 10 << " ms";
  return text.str();
}

void check_rates(const Cfg& cfg, RadarProfile& profile, std::uint32_t data_baud) {
  // baud rate of the data port until the first configDataPort command
  constexpr std::uint32_t firmware_baud = 921600;
  const bool given = cfg.has("configDataPort");
  const std::uint32_t baud = given ? cfg.integer(cfg.last("configDataPort"), 1) : firmware_baud;
  if (baud != data_baud)
    profile.warnings.push_back(
        (given
             ? cfg.where(cfg.last("configDataPort").line) + "configDataPort sets the data port to "
             : cfg.name() + ": without configDataPort the firmware sends at ") +
        std::to_string(baud) + " baud, but radar.data_baud is " + std::to_string(data_baud));
  const double transmit_s = profile.frame_bytes * 10.0 / baud;
  const double period_s = std::ranges::min(profile.subframe_periods_s);
  if (transmit_s < period_s) return;
  const std::string command = cfg.advanced() ? "subFrameCfg" : "frameCfg";
  const std::string what = "requests a frame every " + milliseconds(period_s) +
                           ", but a frame of " + std::to_string(profile.frame_bytes) +
                           " bytes takes " + milliseconds(transmit_s) + " at " +
                           std::to_string(baud) + " baud";
  // A heat map that takes longer to send than the frame period is an error, because the demo then
  // stops sending altogether.
  const CfgCommand& gui = cfg.last("guiMonitor");
  if (cfg.number(gui, 5) != 0 || cfg.number(gui, 6) != 0)
    cfg.fail(cfg.last(command), what +
                                    "; with a heat map the firmware then sends nothing: "
                                    "use a longer period, fewer bins or no heat map");
  profile.warnings.push_back(cfg.where(cfg.last(command).line) + command + ' ' + what);
}

void read_warnings(const Cfg& cfg, RadarProfile& profile, std::uint32_t data_baud) {
  const CfgCommand& frame = cfg.last(cfg.advanced() ? "advFrameCfg" : "frameCfg");
  const std::size_t count = cfg.advanced() ? 3 : 4, trigger = cfg.advanced() ? 4 : 6;
  const std::string where = cfg.where(frame.line) + std::string(frame.words[0]);
  if (cfg.number(frame, count) != 0)
    profile.warnings.push_back(where + " stops after " + std::string(frame.words[count]) +
                               " frames (0 means no limit)");
  if (cfg.number(frame, trigger) != 1)
    profile.warnings.push_back(where + " trigger " + std::string(frame.words[trigger]) +
                               " waits for an external pulse before each frame (1 does not wait)");
  for (unsigned k = 0; k < profile.subframes; ++k)
    if (const CfgCommand* c = cfg.of_subframe("clutterRemoval", k); c && cfg.number(*c, 2) != 0) {
      profile.warnings.push_back(cfg.where(c->line) + "clutterRemoval 1 removes all static echoes");
      break;
    }
  if (profile.bins == 1022)
    profile.warnings.push_back(cfg.where(profile_of(cfg, read_frames(cfg).front()).line) +
                               "profileCfg gives 1024 bins for 12 antennas, but the firmware has "
                               "memory for 1022");
  check_rates(cfg, profile, data_baud);
}

}  // namespace

RadarProfile parse_profile(std::string_view cfg_text, const std::string& name,
                           std::uint32_t data_baud, Board board) {
  require_plain_text(cfg_text, name);
  const auto lines = command_lines(cfg_text);
  if (lines.empty())
    throw Error(ExitCode::config,
                printable(name) + ": contains no command; expected a TI mmWave .cfg file");
  RadarProfile profile;
  Cfg cfg(lines, name, profile);
  std::vector<const char*> needed = {"profileCfg", "frameCfg",   "channelCfg",
                                     "chirpCfg",   "guiMonitor", "sensorStart"};
  if (cfg.advanced()) needed[1] = "advFrameCfg", needed.push_back("subFrameCfg");
  for (const char* command : needed) cfg.require(command);
  cfg.stop_if_faulty();
  std::vector<FrameCfg> frames;
  EnabledAntennas antennas;
  cfg.attempt([&] { frames = read_frames(cfg); });
  cfg.stop_if_faulty();
  cfg.attempt([&] { antennas = read_antennas(cfg, frames.front()); });
  RampSampling sampling;
  cfg.attempt([&] { sampling = sampling_of(cfg, profile_of(cfg, frames.front())); });
  cfg.attempt([&] {
    std::vector<double>& periods_s = profile.subframe_periods_s;
    for (const FrameCfg& f : frames) periods_s.push_back(f.period_s(cfg));
    profile.frame_period_s = std::accumulate(periods_s.begin(), periods_s.end(), 0.0) /
                             static_cast<double>(periods_s.size());
  });
  cfg.attempt([&] { read_gui_monitor(cfg, profile); });
  cfg.stop_if_faulty();
  cfg.attempt([&] { require_equal_subframes(cfg, frames); });
  cfg.attempt([&] { check_ramps(cfg); });
  for (const FrameCfg& f : frames) {
    cfg.attempt([&] { check_chirps(cfg, f); });
    cfg.attempt([&] { check_frame(cfg, f); });
  }
  cfg.stop_if_faulty();
  profile.subframes = static_cast<std::uint32_t>(frames.size());
  read_heat_map(cfg, antennas, board, profile);
  profile.antennas = antennas.virtuals();
  profile.adc_samples = sampling.samples;
  const std::uint32_t fft = std::bit_ceil(sampling.samples);
  profile.bins = bins_of(sampling.samples, profile.antennas);
  const Ramp ramp = ramp_of(cfg, profile_of(cfg, frames.front()));
  profile.range_step_m = ramp.range_step_m(fft);
  profile.resolution_m = ramp.range_step_m(sampling.samples);
  profile.active_s = active_s(cfg, frames.front());
  profile.carrier_hz = ramp.in_steps().carrier_hz();
  profile.frame_bytes = frame_bytes(cfg, profile, frames.front().loops(cfg));
  cfg.attempt([&] { read_warnings(cfg, profile, data_baud); });
  cfg.stop_if_faulty();
  return profile;
}

Axis radar_axis(const RadarProfile& profile) {
  return range_axis("power_with_noise", profile.bins, 0, profile.range_step_m);
}

std::string heat_map_fault(const RadarProfile& profile, const RadarFrame& frame) {
  const std::size_t expected = 2 * profile.array.size() * profile.bins;
  if (frame.array.empty() || (frame.array.size() == expected && frame.planar == profile.planar))
    return {};
  return "the heat map has " + std::to_string(frame.array.size() / 2) + " samples in TLV " +
         (frame.planar ? "8" : "4") + ", but the cfg and radar.board require " +
         std::to_string(expected / 2) + " in TLV " + (profile.planar ? "8" : "4") +
         "; the heat map is ignored";
}

Axis array_axis(const RadarProfile& profile) {
  Axis axis = radar_axis(profile);
  axis.name = "array";
  axis.quantity = "covariance";
  axis.scale = static_cast<double>(profile.array.size());
  return axis;
}

}  // namespace echofuse::radar
