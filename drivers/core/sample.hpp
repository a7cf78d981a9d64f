// SPDX-License-Identifier: MIT
// Samples of the three drivers, with raw device values and raw device clocks. The host time is the
// monotonic time at which the last byte of the sample was read.
#pragma once
#include <cstdint>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "drivers/core/axis.hpp"
#include "drivers/core/clock.hpp"
#include "drivers/core/sensor.hpp"

namespace echofuse {

// One 16-byte record of a time tagger, in memory as on the wire (Swabian time-tag stream).
//   off 0 u8 type | 1 u8 0 | 2 u16 missed events (type 4) | 4 i32 channel | 8 i64 time in ps
enum class TagType : std::uint8_t {
  time_tag = 0,
  error = 1,
  overflow_begin = 2,
  overflow_end = 3,
  missed_events = 4,
};
struct Tag {
  TagType type = TagType::time_tag;
  std::uint8_t reserved = 0;
  std::uint16_t missed_events = 0;
  std::int32_t channel = 0;  // rising edge n, falling edge -n
  std::int64_t time_ps = 0;  // wraps at 2^63 ps

  // Returns true for a well-formed event; other records may contain any time.
  bool is_time_tag() const { return type == TagType::time_tag && reserved == 0; }
};
static_assert(sizeof(Tag) == 16);

struct TagBlock {
  HostTime received{};
  std::span<const Tag> tags;      // valid only during the call that delivers it
  std::uint64_t lost_blocks = 0;  // transport blocks missing before this one
  std::uint64_t lost_items = 0;   // tags dropped by the sender before this one, as it reports
};

// Counts of one exposure from a detector without time tags.
struct HistogramFrame {
  HostTime received{};
  std::uint64_t device_time_us = 0;  // at the end of the exposure
  std::uint32_t exposure_us = 0;
  std::uint64_t pulses = 0;           // laser pulses; 0: unknown
  std::uint32_t zones = 1;            // parts of the field of view
  std::vector<std::uint32_t> counts;  // all bins of zone 0, then of zone 1, ...
  std::uint64_t lost_before = 0;      // histograms missing before this one

  std::uint64_t clicks() const {
    return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  }
};

// TI mmWave demo, TLV 6 (SDK 3.x mmw_output.h): microseconds and per cent.
struct RadarStats {
  std::uint32_t inter_frame_processing_us, transmit_us, inter_frame_margin_us,
      inter_chirp_margin_us, active_frame_load_percent, inter_frame_load_percent;
};
// TLV 9: milliseconds since power-up and degrees Celsius (Rx0-3, Tx0-2, PM, Dig0, Dig1).
struct RadarTemperature {
  std::int32_t invalid;  // 0 means valid
  std::uint32_t time_ms;
  std::int16_t celsius[10];
};

struct RadarFrame {
  HostTime received{};                       // minus the known delay since the first chirp
  std::uint32_t frame_number = 0;            // since power-up
  std::uint32_t time_cpu_cycles = 0;         // 200 MHz, wraps every 21.47 s
  std::uint32_t lost_before = 0;             // frame numbers missing before this one
  std::uint32_t subframe = 0;                // subframes of one frame share its number
  std::uint32_t subframes = 1;               // number per frame in the cfg
  std::vector<std::uint16_t> range_profile;  // log2_q8 codes; empty if the frame had no TLV 2
  std::vector<float> power;                  // linear; from a bridge, which sends no range_profile
  // TLV 4 (azimuth antennas) or 8 (all antennas): for each range bin and virtual antenna the
  // imaginary part, then the real part. Empty if the frame had neither.
  std::vector<std::int16_t> array;
  bool planar = false;  // true: TLV 8, false: TLV 4
  std::optional<RadarStats> stats;
  std::optional<RadarTemperature> temperature;
};

// Result of TI's calibration (measureRangeBiasAndRxChanPhase), or the mean of several. Intended for
// the .cfg: the firmware applies it to its points, not to the range profile.
struct FirmwareBias {
  double range_bias_m = 0;
  std::vector<double>
      re_im;  // real and imaginary part of each virtual antenna, as in compRangeBiasAndRxChanPhase
  std::int64_t lines = 0;
};

// Drivers reject frames with a longer side.
inline constexpr std::uint32_t max_depth_side = 8192;

struct DepthFrame {
  HostTime received{};
  std::uint64_t device_time_us = 0;
  std::uint32_t frame_number = 0;
  std::uint32_t lost_before = 0;
  std::uint32_t width = 0, height = 0;
  std::vector<std::uint16_t> depth_mm;  // z, row-major, 0 = no measurement
};

}  // namespace echofuse
