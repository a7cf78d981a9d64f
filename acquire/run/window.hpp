// SPDX-License-Identifier: MIT
// Combines samples into one fused record per slot. Pure: no clock, device or file.
//
// Time of a sample: its device time, converted to host time by ClockFit; the time of receipt
// without a sound fit. Never after its receipt.
// Slot of a sample: the open slot with [start, end) containing that time, independent of its
// arrival.
//   early         before slot 0: counted as `early`, not used
//   outside       after the run's last slot: counted as `outside`, not used
//   late          its slot is closed already: counted as `late`, also for that slot's record; not
//   used
//   duplicate     a frame with the number and device time of one of the eight previous frames:
//   counted as `duplicate`, not used
//   out of order  a frame with a lower number than its predecessor: used normally, counted as
//   `out_of_order`; tags: counted in `backwards` of the record
// A block of tags is split where its times cross a border, found by bisection, so an out-of-order
// tag may stay with its neighbours. A marker stays with the next event of its block.
// Losses belong to the slot of the sample that reports them or, if that is closed, to the next one.
// Every received tag is counted in exactly one record, or as early, late or outside.
//
// Contents of a record
//   spd    every click of the slot's tags relative to the last start before it. A start remains
//   valid across slot borders, but not across gaps in the tags. Valid if there was a start and the
//   tags span half of the slot (counts are not rates, so a short stream is not comparable). For a
//   detector that sends histograms: the sum of those with mid-exposure in the slot, under the same
//   rule.
//   radar  mean over the frames of linear power, stored as log2_q8 codes; a single frame is stored
//   unchanged. Valid with one usable frame.
//   array  statistics of the same frames, if they have a heat map (measurement/radar_array.hpp).
//   Frames with consecutive numbers are consecutive.
//   depth  the frame nearest to the slot's centre. Valid with one usable frame.
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
#include "acquire/record/fused_record.hpp"
#include "acquire/run/scheduler.hpp"
#include "acquire/stream/clock_fit.hpp"
#include "drivers/tdc/histogram.hpp"

namespace echofuse::acquire {

// Samples that are in no record: tags for the SPD, frames for the others.
struct UnassignedSamples {
  PerSensor<std::uint64_t> early{}, late{}, outside{}, duplicate{}, out_of_order{};
};

class Windows {
 public:
  // `clocks` must outlive this, and must observe every sample before it is added here.
  Windows(const SlotGrid& grid, const tdc::HistogramSettings& tdc, const SensorClocks& clocks,
          SensorSet configured, SensorSet required = {});

  // Sets axes and zones of a device. The first announcement of an axis is valid for the run.
  // Returns false for a device with another axis or other zones: its samples are ignored until a
  // device with the first axis and zones is announced.
  bool announce(const DeviceInfo& info);
  // Returns the axes known so far.
  std::vector<Axis> axes() const;
  const Zones& zones() const { return zones_; }
  void add(const TagBlock& block);
  void add(const HistogramFrame& frame);
  void add(const RadarFrame& frame);
  void add(DepthFrame frame);

  // Closes slots in order, each once. The caller sets label and UTC.
  record::FusedRecord close(const DueSlot& slot);
  // Ends the run: samples of later slots are counted as `outside`.
  void finish();
  const UnassignedSamples& unassigned() const { return unassigned_; }
  UnassignedSamples take_unassigned() {
    return std::exchange(unassigned_, {});
  }  // since the last
     // call
  // Returns late samples since the last call, for the first 256 slots; unassigned() has all.
  record::LateCounts take_late() { return std::exchange(late_, {}); }

 private:
  struct SampleTimes {  // times at which the samples in use were taken
    HostTime first{}, last{};
    double from_centre_s = 0, weight = 0;
    std::int64_t count = 0;
    void add(HostTime from, HostTime to, HostTime centre, double tags = 1);
    void describe(record::SensorSync& sync) const;
  };
  struct Slot {
    std::shared_ptr<tdc::Histogram> histogram;  // created with the first tags
    std::vector<std::uint32_t> summed;          // counts of a detector that sends histograms
    TagCounts summed_tags;
    std::uint64_t spd_lost = 0;
    SampleTimes spd_times;
    TagCounts tags() const { return histogram ? histogram->tag_counts() : summed_tags; }

    std::vector<double> power;
    std::vector<std::uint16_t> first_codes;
    std::uint64_t radar_frames = 0, radar_lost = 0;
    SampleTimes radar_times;
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

  // Numbers of the last frames, to detect repeated ones.
  class FrameNumbers {
   public:
    enum class Order { next, repeated, back };
    Order put(std::uint32_t number, std::uint64_t device_time);

   private:
    std::array<std::pair<std::uint32_t, std::uint64_t>, 8> last_{};
    std::size_t count_ = 0;
  };

  Slot* find(Sensor sensor, HostTime taken, std::uint64_t amount);
  void add_lost(std::uint64_t Slot::*lost, HostTime taken, std::uint64_t amount);
  bool repeated(Sensor sensor, FrameNumbers::Order order);
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
  std::optional<HostTime> overflow_from_;      // start of the current overflow
  std::map<std::string, Axis> axes_;           // array, depth_x, depth_y, radar, spd
  Zones zones_;                                // announced with the axis spd
  bool sends_histograms_ = false;
  PerSensor<bool> refused_{};
  std::map<std::int64_t, Slot> open_;
  std::int64_t next_ = 0;  // first open slot
  FrameNumbers radar_numbers_, depth_numbers_;
  UnassignedSamples unassigned_;
  record::LateCounts late_;
};

}  // namespace echofuse::acquire
