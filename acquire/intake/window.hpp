// SPDX-License-Identifier: MIT
// Combines samples into one fused record per slot. Pure: no clock, device or file.
//
// Time of a sample: its device time, converted to host time by ClockFit, or the time of receipt if
// the fit is not sound. The time of a sample is never later than its receipt.
// A sample belongs to the open slot that contains its time, regardless of when it arrives. The
// exceptions are counted under these names and, unless stated otherwise, not used:
//   early         the sample is from before slot 0
//   outside       the sample is from after the last slot of the run
//   late          its slot is already closed; also counted in the record of that slot
//   duplicate     a frame with the number and device time of one of the eight previous frames
//   out_of_order  a frame with a number up to eight below the previous one; it is used normally
// Out-of-order tags are used and counted as `backwards` in the record.
// A block of tags is split where its times cross a slot border. The border is found by bisection,
// so an out-of-order tag may stay with its neighbours. A marker stays with the next event of its
// block.
// Losses are counted in the slot of the sample that reports them or, if that slot is closed, in the
// next open slot. Every received tag is counted in exactly one record, or as early, late or
// outside.
//
// Contents of a record
//   spd    Histogram of the clicks in the slot, relative to the last start before each click. A
//          start remains valid across slot borders, but not across gaps in the tags. Valid if there
//          was a start and the tags span half of the slot, because the counts of a shorter stream
//          are not comparable. For a detector that sends histograms: the sum of all histograms with
//          mid-exposure in the slot; they must also span half of the slot.
//   radar  Mean linear power of the frames. Valid if there is a usable frame.
//   array  Statistics of the same frames, if they have a heat map (measurement/radar_array.hpp).
//          Two frames are consecutive if their frame numbers are.
//   depth  The frame nearest to the centre of the slot. Valid if there is a usable frame.
#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "acquire/intake/clock_fit.hpp"
#include "acquire/intake/scheduler.hpp"
#include "acquire/measurement/radar_array.hpp"
#include "acquire/record/fused_record.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// Numbers of SPD tags, radar frames and camera frames that are not in any record. The samples
// counted by `out_of_order` are an exception, because they are in a record.
struct UnassignedSamples {
  PerSensor<std::uint64_t> early{}, late{}, outside{}, duplicate{}, out_of_order{};
};

class Windows {
 public:
  // `clocks` must outlive this object, and must observe every sample before it is added here.
  Windows(const SlotGrid& grid, const tdc::HistogramSettings& tdc, const SensorClocks& clocks,
          SensorSet configured, SensorSet required = {});

  // Begins slot 0 at the time `first`, which replaces the start of the grid.
  void begin(HostTime first) { grid_.first = first, blocks_ = block_tags_ = 0; }
  // Sets the axes of a device. The axes that are announced first apply to the whole run. Returns
  // false if a device has other axes. Its samples are then ignored until a device with the first
  // axes is announced.
  bool announce(const DeviceInfo& info);
  std::vector<Axis> axes() const;
  void add(const TagBlock& block);
  void add(const HistogramFrame& frame);
  void add(const RadarFrame& frame);
  void add(DepthFrame frame);

  // Closes a slot and returns its record; the caller sets the record's label and UTC. Must be
  // called once per slot, in order.
  record::FusedRecord close(const DueSlot& slot);
  // Ends the run: samples of later slots are counted as `outside`.
  void finish();
  const UnassignedSamples& unassigned() const { return unassigned_; }
  // Returns the numbers of unassigned samples since the last call.
  UnassignedSamples take_unassigned() { return std::exchange(unassigned_, {}); }
  // Returns the number of late samples of each slot since the last call, for at most 256 slots. The
  // counts of unassigned() include all late samples.
  record::LateCounts take_late() { return std::exchange(late_, {}); }

 private:
  // Times at which the samples of a slot were taken.
  struct SampleTimes {
    HostTime first{}, last{};
    double from_centre_s = 0, weight = 0;
    std::int64_t count = 0;
    void add(HostTime from, HostTime to, HostTime centre, double tags = 1);
    void describe(record::SensorSync& sync) const;
  };
  struct Arrived {
    std::uint64_t frames = 0, lost = 0;  // in the unit of SensorSync::lost
    SampleTimes times;
    std::optional<std::uint32_t> last;
    record::Verdict fault;  // reason why a frame cannot be used
    // Number of samples of earlier slots that arrived while this slot was the first open one.
    std::uint64_t late = 0;
  };
  struct Slot {
    PerSensor<Arrived> arrived;
    std::shared_ptr<tdc::Histogram> histogram;  // created when the first tags arrive
    std::vector<std::uint32_t> summed;          // summed counts of a detector that sends histograms
    TagCounts summed_tags;
    std::uint64_t lost_blocks = 0;
    TagCounts tags() const { return histogram ? histogram->tag_counts() : summed_tags; }

    std::vector<double> power;
    std::optional<record::ArrayStatistics> array;
    std::uint32_t array_last = 0;  // number of the last frame in `array`
    std::optional<RadarStats> stats;
    std::optional<RadarTemperature> temperature;

    std::optional<DepthFrame> depth;
  };

  // Numbers and device times of the last eight frames. Detects repeated frames and frames that are
  // out of order.
  class FrameNumbers {
   public:
    enum class Order { next, repeated, back };
    Order put(std::uint32_t number, std::uint64_t device_time);

   private:
    std::deque<std::pair<std::uint32_t, std::uint64_t>> last_;
  };

  Slot* find(Sensor sensor, HostTime taken, std::uint64_t amount);
  void add_lost(Sensor sensor, HostTime taken, std::uint64_t amount, std::uint64_t blocks = 0);
  Slot* add_frame(Sensor sensor, HostTime taken, std::uint32_t lost, std::uint32_t number,
                  std::uint64_t device_time);
  void add_part(std::span<const Tag> tags, HostTime from, HostTime to);
  void take_profile(Slot& slot, const RadarFrame& frame, HostTime taken);
  void take_array(Slot& slot, const RadarFrame& frame) const;
  record::Verdict spd_fault(const Slot& slot, HostTime end) const;
  record::Verdict fault_of(const Slot& slot, Sensor sensor, HostTime end) const;
  void fill_spd(const Slot& slot, record::FusedRecord& record) const;
  static void fill_radar(Slot& slot, record::FusedRecord& record);

  SlotGrid grid_;
  const SensorClocks& clocks_;
  SensorSet configured_, required_;
  std::shared_ptr<tdc::Histogram> histogram_;  // histogram of the slot that contains the last tags
  // Start of the current overflow; no value outside an overflow.
  std::optional<HostTime> overflow_from_;
  std::map<std::string, Axis> axes_;  // axes by name: array, depth_x, depth_y, radar, spd
  bool sends_histograms_ = false;
  std::uint64_t blocks_ = 0, block_tags_ = 0;  // received tag blocks, and their tags
  PerSensor<bool> refused_{};
  std::map<std::int64_t, Slot> open_;
  std::int64_t next_ = 0;
  PerSensor<FrameNumbers> numbers_;  // radar and depth
  UnassignedSamples unassigned_;
  record::LateCounts late_;
};

}  // namespace echofuse::acquire
