// SPDX-License-Identifier: MIT
// Samples of the three kinds of sensor, with unprocessed device values and device times. Unless
// noted, `received` is the monotonic host time at which the last byte of the sample was read.
#pragma once
#include <cmath>
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

// One 16-byte record of a time tagger, with the same layout in memory and on the wire (Swabian
// time-tag stream).
//   offset 0 u8 type, 1 u8 reserved = 0, 2 u16 missed events (type 4), 4 i32 channel,
//   8 i64 time in ps
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
  std::int32_t channel = 0;  // n for a rising edge on input n, -n for a falling edge
  std::int64_t time_ps = 0;  // wraps at 2^63 ps

  // Returns true if the type is known and the reserved byte is 0.
  bool is_valid() const { return type <= TagType::missed_events && reserved == 0; }
  // Returns true if the record is a valid time tag. In all other records, `time_ps` may have any
  // value.
  bool is_time_tag() const { return type == TagType::time_tag && reserved == 0; }
};
static_assert(sizeof(Tag) == 16);

struct TagBlock {
  HostTime received{};
  std::span<const Tag> tags;      // valid only during the call that delivers it
  std::uint64_t lost_blocks = 0;  // number of transport blocks lost before this block
  std::uint64_t lost_items = 0;   // number of tags dropped by the sender before this block
};

// Counts from one exposure of a detector that sends histograms instead of time tags.
struct HistogramFrame {
  HostTime received{};
  std::uint64_t device_time_us = 0;  // device time at the end of the exposure
  std::uint32_t exposure_us = 0;
  std::uint64_t pulses = 0;  // number of laser pulses; 0 if unknown
  std::uint32_t zones = 1;
  std::vector<std::uint32_t> counts;  // all bins of zone 0, then all bins of zone 1, and so on
  std::uint64_t lost_before = 0;      // number of histograms missing before this one

  std::uint64_t clicks() const {
    return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  }
};

// TLV 6 of TI's mmWave demo (SDK 3.x mmw_output.h): times in microseconds, loads in per cent.
struct RadarStats {
  std::uint32_t inter_frame_processing_us, transmit_us, inter_frame_margin_us,
      inter_chirp_margin_us, active_frame_load_percent, inter_frame_load_percent;
};
// TLV 9 of TI's mmWave demo: milliseconds since power-up, and temperatures of Rx0-3, Tx0-2, PM,
// Dig0 and Dig1 in degrees Celsius.
struct RadarTemperature {
  std::int32_t invalid;  // 0 if the temperatures are valid
  std::uint32_t time_ms;
  std::int16_t celsius[10];
};

// Limits of radar power, which may be negative after noise subtraction. `max_radar_power` is below
// the largest float, so that interpolation cannot overflow. If the largest power of a profile is
// below `min_radar_power`, powers that are 80 dB lower lose digits as floats.
inline constexpr float max_radar_power = 1e38F;
inline constexpr double min_radar_power = 1e-30;
inline bool is_power(double v) { return std::abs(v) < max_radar_power; }

struct RadarFrame {
  static constexpr double clock_hz = 200e6;  // TI SDK 3, MmwDemo_output_message_header
  HostTime received{};                // arrival time minus the known delay since the first chirp
  std::uint32_t frame_number = 0;     // frame number, counted since power-up
  std::uint32_t time_cpu_cycles = 0;  // device time in cycles of clock_hz; wraps every 21.47 s
  std::uint32_t lost_before = 0;      // number of frames missing before this one
  std::uint32_t subframe = 0;         // index of the subframe within its frame
  std::uint32_t subframes = 1;        // number of subframes per frame, according to the cfg
  std::vector<float> power;           // range profile, linear power; empty if not sent
  // Heat map from TLV 4 (azimuth antennas) or TLV 8 (all antennas). For each range bin and virtual
  // antenna there are two values: the imaginary part, then the real part. Empty if the frame had
  // neither TLV.
  std::vector<std::int16_t> array;
  bool planar = false;  // true: `array` is from TLV 8; false: from TLV 4
  std::optional<RadarStats> stats;
  std::optional<RadarTemperature> temperature;
};

// Result of TI's calibration (measureRangeBiasAndRxChanPhase), or the mean of several results. The
// user enters it in the .cfg. The firmware applies it to its point cloud, not to the range profile.
struct FirmwareBias {
  double range_bias_m = 0;
  // real and imaginary parts of the coefficient of each virtual antenna, as in
  // compRangeBiasAndRxChanPhase
  std::vector<double> re_im;
  std::int64_t lines = 0;  // number of results that were averaged
};

// Largest width and height of a depth frame. Drivers reject larger frames.
inline constexpr std::uint32_t max_depth_side = 8192;

struct DepthFrame {
  HostTime received{};
  std::uint64_t device_time_us = 0;
  std::uint32_t frame_number = 0;
  std::uint32_t lost_before = 0;
  std::uint32_t width = 0, height = 0;
  std::vector<std::uint16_t> depth_mm;  // depth z in row-major order; 0 means no measurement
};

}  // namespace echofuse
