// SPDX-License-Identifier: MIT
// Samples -> one fused record a slot. Pure: no clock, no device, no file.
//
// Time of a sample: its device's clock, as ClockFit maps it to the host's; its receipt without a
// sound fit. Never after its receipt.
// Slot of a sample: the open one whose [start, end) holds that time, whenever it arrives.
//   early         before slot 0: counted as `early`, used nowhere
//   outside       after the run's last slot: counted as `outside`, used nowhere
//   late          its slot was closed already: counted as `late`, and of that slot's record; used
//                 nowhere, moves nothing
//   duplicate     a frame with the number and the device time of one of the eight before it:
//                 counted as `duplicate`, used nowhere
//   out of order  a frame with a lower number than the one before it: used as any other, counted as
//                 `out_of_order`; tags: `backwards` of the record
// A block of tags is cut where its times cross a border, found by bisection: a tag out of order may
// stay with its neighbours. A marker goes with the event that follows it in its block.
// Losses belong to the slot of the sample that reports them or, if that is closed, to the next one.
// Every tag that arrives is in the counts of exactly one record, or early, late or outside.
//
// What a record holds
//   spd    every click of the slot's tags against the last start before it; a start survives the
//          border between slots, but no gap in the tags. Valid if there was a start and the tags
//          span half of the slot (counts are not rates: a short stream cannot be compared). Of a
//          detector that sends histograms, the sum of those with the middle of their exposure in
//          the slot, under the same rule.
//   radar  mean over the frames of linear power, in log2_q8 codes again; a single frame is kept as
//          it came. Valid with one usable frame.
//   array  of the same frames, as far as they have a heat map (measurement/radar_array.hpp).
//          Frames are neighbours if their numbers are.
//   depth  the frame nearest the slot's centre. Valid with one usable frame.
#pragma once
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/record.hpp"
#include "acquire/run/clock_fit.hpp"
#include "acquire/run/scheduler.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// Samples that are in no record: tags for the SPD, frames for the others.
struct UnassignedSamples {
  PerSensor<std::uint64_t> early{}, late{}, outside{}, duplicate{}, out_of_order{};
};

class Windows {
 public:
  // `clocks` outlives this and observes every sample before it is added here.
  Windows(const SlotGrid& grid, const tdc::HistogramSettings& tdc, const SensorClocks& clocks,
          SensorSet configured, SensorSet required = {});

  // Takes the meaning of a device's samples. The first announcement of an axis holds for the run.
  // False for a device with another axis or zones: its samples are not used until it fits again.
  bool announce(const DeviceInfo& info);
  // The axes known so far.
  std::vector<Axis> axes() const;
  const Zones& zones() const { return zones_; }
  void add(const TagBlock& block);
  void add(const HistogramFrame& frame);
  void add(const RadarFrame& frame);
  void add(DepthFrame frame);

  // Closes slots in order, each once. Label and UTC are left to the caller.
  record::FusedRecord close(const DueSlot& slot);
  // The run is over: what was gathered for later slots becomes `outside`.
  void finish();
  const UnassignedSamples& unassigned() const { return unassigned_; }
  UnassignedSamples take_unassigned() { return std::exchange(unassigned_, {}); }  // since last call
  // Returns late samples since the last call, of the first 256 slots; unassigned() has all.
  record::LateCounts take_late() { return std::exchange(late_, {}); }

 private:
  struct Times {  // when what was used was taken
    HostTime first{}, last{};
    double from_centre_s = 0, weight = 0;
    std::int64_t count = 0;
    void add(HostTime from, HostTime to, HostTime centre, double tags = 1);
    void describe(record::SensorSync& sync) const;
  };
  struct Slot {
    std::shared_ptr<tdc::Histogram> histogram;  // from its first tags on
    std::vector<std::uint32_t> summed;          // counts of a detector that sends histograms
    TagCounts summed_tags;
    std::uint64_t spd_lost = 0;
    Times spd_times;
    TagCounts tags() const { return histogram ? histogram->tag_counts() : summed_tags; }

    std::vector<double> power;
    std::vector<std::uint16_t> first_codes;
    std::uint64_t radar_frames = 0, radar_lost = 0;
    Times radar_times;
    std::optional<record::ArrayStatistics> array;
    std::uint32_t array_last = 0;  // number of its last frame
    std::string radar_fault;
    std::optional<RadarStats> stats;
    std::optional<RadarTemperature> temperature;

    std::optional<DepthFrame> depth;
    HostTime depth_taken{};
    std::uint64_t depth_frames = 0, depth_lost = 0;
    std::optional<std::uint32_t> radar_last, depth_last;
    std::string depth_fault;
  };

  // Numbers of the last frames, which tell a repeated one.
  class Numbers {
   public:
    enum class Order { next, repeated, back };
    Order put(std::uint32_t number, std::uint64_t device_time);

   private:
    std::array<std::pair<std::uint32_t, std::uint64_t>, 8> last_{};
    std::size_t count_ = 0;
  };

  Slot* find(Sensor sensor, HostTime taken, std::uint64_t amount);
  void add_lost(std::uint64_t Slot::*lost, HostTime taken, std::uint64_t amount);
  bool repeated(Sensor sensor, Numbers::Order order);
  void add_part(std::span<const Tag> tags, HostTime from, HostTime to);
  void take_profile(Slot& slot, const RadarFrame& frame, HostTime taken);
  void take_array(Slot& slot, const RadarFrame& frame) const;
  std::string spd_fault(const Slot& slot, HostTime end) const;
  std::string radar_fault(const Slot& slot) const;
  std::string depth_fault(const Slot& slot) const;
  void fill_spd(const Slot& slot, record::FusedRecord& record) const;
  void fill_radar(Slot& slot, record::FusedRecord& record) const;
  void fill_depth(Slot& slot, record::FusedRecord& record) const;

  SlotGrid grid_;
  const SensorClocks& clocks_;
  SensorSet configured_, required_;
  std::shared_ptr<tdc::Histogram> histogram_;  // slot of the last tags
  std::optional<HostTime> overflow_from_;      // begin of the current overflow
  std::map<std::string, Axis> axes_;           // array, depth_x, depth_y, radar, spd
  Zones zones_;                                // announced with the axis spd
  bool sends_histograms_ = false;
  PerSensor<bool> refused_{};
  std::map<std::int64_t, Slot> open_;
  std::int64_t next_ = 0;  // first slot that is not closed
  Numbers radar_numbers_, depth_numbers_;
  UnassignedSamples unassigned_;
  record::LateCounts late_;
};

}  // namespace echofuse::acquire
