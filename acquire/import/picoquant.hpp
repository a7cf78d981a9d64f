// SPDX-License-Identifier: MIT
// Reads PicoQuant time tags (.ptu) as the tags of a tagger.
// Source: Read_PTU.py of PicoQuant's demos. A record is a u32:
//   HydraHarp, TimeHarp 260, MultiHarp, generic
//     T2  31 special, 30:25 channel, 24:0 time    special 63: overflow of 33,554,432, `time` times
//                                                 (0: once; version 1: once, of 33,552,000),
//                                                 0: sync, 1 to 15: marker
//     T3  31 special, 30:25 channel, 24:10 dtime, 9:0 nsync    special 63: overflow of 1024,
//                                                 `nsync` times (0: once), 1 to 15: marker
//   PicoHarp
//     T2  31:28 channel, 27:0 time                channel 15: marker, or overflow of 210,698,240
//                                                 if its last four bits are 0
//     T3  31:28 channel, 27:16 dtime, 15:0 nsync  channel 15: marker, or overflow of 65536 if dtime
//                                                 is 0
// In T2 mode, times are in units of MeasDesc_GlobalResolution. In T3 mode,
// MeasDesc_GlobalResolution is the sync period, and dtime is in units of MeasDesc_Resolution.
#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "acquire/import/recording.hpp"
#include "acquire/import/tagged_file.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// Channel number of the sync input; input n has channel number n.
inline constexpr std::int32_t sync_channel = 0;

// Converts PicoQuant records into tags. Does no I/O.
class PicoquantRecords {
 public:
  // Throws Error(failed) if the record type is unknown or a resolution is not positive. `offset` is
  // the value of MeasDesc_Offset in ns, which the device subtracted from the times of T3 clicks.
  PicoquantRecords(std::uint32_t type, double global_resolution_s, double resolution_s,
                   double offset = 0);
  bool is_t3() const { return t3_; }
  // Appends the tags of a record: none, one or, in T3 mode, the start and the click of a pulse. T3
  // files omit all pulses that are not followed by a click. Returns false if the time exceeds 2^63
  // ps.
  bool add(std::uint32_t record, std::vector<Tag>& out);
  std::uint64_t markers() const { return markers_; }
  // Returns the number of T3 clicks that follow their sync pulse by more than one sync period.
  std::uint64_t behind_period() const { return behind_period_; }
  long double offset_ps() const { return offset_ps_; }
  // Time of the last overflow, and duration of one overflow period, in ps.
  long double overflowed_ps() const { return static_cast<long double>(base_) * unit_ps_; }
  long double wrap_ps() const { return static_cast<long double>(wrap_) * unit_ps_; }
  // Unit of the record times, and unit of the delay from start to click; both in ps.
  long double unit_ps() const { return unit_ps_; }
  long double step_ps() const { return t3_ ? dtime_ps_ : unit_ps_; }

 private:
  bool put(std::int32_t channel, std::uint64_t unit, std::uint64_t dtime, std::vector<Tag>& out);
  bool pico_harp_ = false, t3_ = false, single_overflow_ = false;
  std::uint64_t wrap_ = 0, base_ = 0, markers_ = 0, behind_period_ = 0;
  long double offset_ps_ = 0;
  std::uint64_t pulse_ = ~std::uint64_t{0};  // number of the last pulse with a start tag
  long double unit_ps_, dtime_ps_;
};

// Reads a .ptu file in blocks of at most 10 ms. `use` contains the selected inputs and the
// histogram bins. Tags after the end time in the header are omitted, because a single corrupted
// overflow record can shift times by days. Throws Error(failed) if the file is not a .ptu file, its
// record type is unknown, or its header contradicts the mode (T2 or T3) of the records.
class PicoquantTags final : public Recording {
 public:
  PicoquantTags(const std::string& path, const tdc::HistogramSettings& use);
  DeviceInfo device() const override;
  bool next(SampleSink& sink) override;
  HostTime at() const override { return at_; }
  std::vector<Counter> counters() const override;
  bool usable() const override { return missing_input().empty(); }
  std::vector<std::string> doubts() const override;
  std::optional<UtcTime> began() const;  // start time, converted from the local time in the file
  // Returns true if the local start time occurred twice because summer time ended.
  bool has_ambiguous_start() const;

 private:
  bool read_record();
  long double end_ps() const { return std::max(last_ps_, records_.overflowed_ps()); }
  std::string missing_input() const;
  std::vector<std::string> rate_doubts() const;
  TaggedFile file_;
  PicoquantRecords records_;
  tdc::HistogramSettings use_;
  // Values from the header, in s; 0 if unknown: the time at which the measurement stopped, and the
  // latest tag time that the header allows.
  double stopped_s_ = 0, header_s_ = 0;
  long double last_ps_ = 0;  // time of the latest tag, ps
  std::int64_t first_sync_ps_ = -1, last_sync_ps_ = 0;
  // Tags of the current block, followed by tags that belong to the next block.
  std::vector<Tag> tags_;
  std::vector<std::uint32_t> chunk_;
  std::size_t in_chunk_ = 0;
  HostTime at_{};
  std::uint64_t count_ = 0, bytes_cut_ = 0;
  std::array<std::uint64_t, 65> by_channel_{};
  bool beyond_ = false;
};

}  // namespace echofuse::acquire
