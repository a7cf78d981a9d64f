// SPDX-License-Identifier: MIT
// Samples -> one fused record a slot. Pure: no clock, no device, no file.
//
// Which slot a sample belongs to: the one whose [start, end) holds the host time of its receipt. A
// block of tags is received as a whole and never split.
//   early      before slot 0, or after the run's last slot: counted as `outside`, used nowhere
//   late       its slot was closed already: counted as `late`, used nowhere, moves nothing
//   duplicate  a frame with the number of the frame before it: counted as `duplicate`
// Every tag that arrives is in the counts of exactly one record, or late, or outside.
//
// What a record holds
//   spd    every click of the slot's tags against the last start before it; a start survives the
//          border between slots, but no gap in the tags. Valid if there was a start and the blocks
//          span half of the slot (counts are not rates: a short stream cannot be compared).
//   radar  mean over the frames of linear power, in log2_q8 codes again; a single frame is kept as
//          it came. Valid with one usable frame.
//   depth  the frame nearest the slot's centre. Valid with one usable frame.
#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "acquire/record/record.hpp"
#include "acquire/scheduler.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// Samples that are in no record: tags for the SPD, frames for the others.
struct Strays {
  std::array<std::uint64_t, sensor_count> late{}, outside{}, duplicate{};
};

class Windows {
 public:
  // `configured`: bit 0 SPD, 1 radar, 2 depth.
  Windows(const SlotGrid& grid, const tdc::HistogramSettings& tdc, std::uint32_t configured);

  // What a device's samples mean. The first announcement of an axis holds for the run; a device
  // that comes back with another one is not used (false) until it fits again.
  bool announce(const DeviceInfo& info);
  // The axes known so far.
  std::vector<Axis> axes() const;
  // The tag stream was interrupted: no click refers to a start before this.
  void tag_gap() { histogram_.forget_start(); }

  void add(const TagBlock& block);
  void add(const RadarFrame& frame);
  void add(DepthFrame frame);

  // In order, each once. Label and UTC are left to the caller.
  record::FusedRecord close(const DueSlot& slot);
  // The run is over: what was gathered for later slots becomes `outside`.
  void finish();
  const Strays& strays() const { return strays_; }

 private:
  struct Receipts {  // when what was used arrived
    HostTime first{}, last{};
    std::chrono::nanoseconds from_centre{0};  // sum
    std::int64_t count = 0;
    void add(HostTime received, HostTime centre);
    void describe(record::SensorSync& sync) const;
  };
  struct Slot {
    std::vector<std::uint32_t> spd;
    tdc::TagCounts tags;
    std::uint64_t spd_lost = 0;
    Receipts spd_receipts;

    std::vector<double> power;
    std::vector<std::uint16_t> first_codes;
    std::uint64_t radar_frames = 0, radar_lost = 0;
    Receipts radar_receipts;
    std::string radar_fault;
    std::optional<RadarStats> stats;
    std::optional<RadarTemperature> temperature;

    std::optional<DepthFrame> depth;
    std::uint64_t depth_frames = 0, depth_lost = 0;
    std::optional<std::uint32_t> radar_last, depth_last;
    std::string depth_fault;
  };

  Slot* find(Sensor sensor, HostTime received, std::uint64_t amount);
  void settle_tags();
  std::string spd_fault(const Slot& slot) const;
  std::string radar_fault(const Slot& slot) const;
  std::string depth_fault(const Slot& slot) const;
  void fill_spd(Slot& slot, record::FusedRecord& record) const;
  void fill_radar(const Slot& slot, record::FusedRecord& record) const;
  void fill_depth(Slot& slot, record::FusedRecord& record) const;

  SlotGrid grid_;
  std::uint32_t configured_;
  tdc::Histogram histogram_;  // of the slot tag_slot_, in the order of arrival
  std::int64_t tag_slot_ = 0;
  std::map<std::string, Axis> axes_;  // radar, depth_x, depth_y
  std::array<bool, sensor_count> refused_{};
  std::map<std::int64_t, Slot> open_;
  std::int64_t next_ = 0;  // first slot that is not closed
  std::optional<std::uint32_t> last_radar_number_;
  std::optional<std::pair<std::uint32_t, std::uint64_t>> last_depth_number_;
  Strays strays_;
};

}  // namespace echofuse::acquire
