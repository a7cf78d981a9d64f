// SPDX-License-Identifier: MIT
#include "acquire/intake/window.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <utility>

namespace echofuse::acquire {

using record::ok_verdict;
using record::VerdictKind;

namespace {

constexpr std::size_t max_late_slots = 256;
const record::Verdict axis_changed{VerdictKind::other_axis,
                                   "differs from the one at the start of the run"};

std::string size_of(std::uint32_t width, std::uint32_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

// Returns the axis that is stored in the run for the axis of a device. For "array", this is the
// axis of the array statistics.
Axis kept_axis(const Axis& axis) {
  return axis.name == "array" ? record::array_axis(axis, record::antennas_of(axis)) : axis;
}

}  // namespace

void Windows::SampleTimes::add(HostTime from, HostTime to, HostTime centre, double tags) {
  if (count == 0 || from < first) first = from;
  if (count == 0 || to > last) last = to;
  from_centre_s += tags * (seconds(from - centre) + seconds(to - centre)) / 2;
  weight += tags;
  ++count;
}

void Windows::SampleTimes::describe(record::SensorSync& sync) const {
  if (count == 0) return;
  sync.offset_s = from_centre_s / weight;
  sync.span_s = seconds(last - first);
}

Windows::FrameNumbers::Order Windows::FrameNumbers::put(std::uint32_t number,
                                                        std::uint64_t device_time) {
  const std::pair frame(number, device_time);
  const bool repeated = std::ranges::find(last_, frame) != last_.end() && !lacks_numbers(last_);
  const std::uint32_t before = last_.empty() ? number : last_.back().first;
  last_.push_back(frame);
  if (last_.size() > unnumbered_frames) last_.pop_front();
  if (repeated) return Order::repeated;
  // A larger step back is a restart of the numbering, or a damaged number.
  constexpr std::uint32_t farthest_back = 8;
  return before - number - 1 < farthest_back ? Order::back : Order::next;
}

Windows::Windows(const SlotGrid& grid, const tdc::HistogramSettings& tdc,
                 const SensorClocks& clocks, SensorSet configured, SensorSet required)
    : grid_(grid),
      clocks_(clocks),
      configured_(configured),
      required_(required),
      histogram_(std::make_shared<tdc::Histogram>(tdc)) {}

bool Windows::announce(const DeviceInfo& info) {
  bool fits = true;
  const bool tagger = info.sensor == Sensor::spd && info.axes.empty();
  if (info.sensor == Sensor::spd) sends_histograms_ = !tagger;
  for (const auto& sent : tagger ? std::vector{histogram_->axis()} : info.axes) {
    const Axis axis = kept_axis(sent);
    fits = same_axis(axes_.try_emplace(axis.name, axis).first->second, axis) && fits;
  }
  refused_[info.sensor] = !fits;
  return fits;
}

std::vector<Axis> Windows::axes() const {
  std::vector<Axis> all;
  for (const auto& [name, axis] : axes_) all.insert(name == "spd" ? all.begin() : all.end(), axis);
  return all;
}

// Returns the open slot that contains the time `taken`. If the slot at that time is not open,
// counts `amount` tags or frames as early or late and returns nullptr.
Windows::Slot* Windows::find(Sensor sensor, HostTime taken, std::uint64_t amount) {
  const std::int64_t k = grid_.slot_of(taken);
  if (k >= next_) return &open_[k];
  (k < 0 ? unassigned_.early : unassigned_.late)[sensor] += amount;
  if (k >= 0) open_[next_].arrived[sensor].late += amount;
  if (k >= 0 && (late_.size() < max_late_slots || late_.contains(k))) late_[k][sensor] += amount;
  return nullptr;
}

void Windows::add_lost(Sensor sensor, HostTime taken, std::uint64_t amount, std::uint64_t blocks) {
  const std::int64_t k = grid_.slot_of(taken);
  if (amount == 0 || k < 0) return;
  Slot& slot = open_[std::max(k, next_)];
  slot.arrived[sensor].lost += amount, slot.lost_blocks += blocks;
}

// Counts a frame. Returns its slot; nullptr if the frame is repeated or its slot is not open.
Windows::Slot* Windows::add_frame(Sensor sensor, HostTime taken, std::uint32_t lost,
                                  std::uint32_t number, std::uint64_t device_time) {
  add_lost(sensor, taken, lost);
  const auto order = numbers_[sensor].put(number, device_time);
  unassigned_.duplicate[sensor] += order == FrameNumbers::Order::repeated;
  unassigned_.out_of_order[sensor] += order == FrameNumbers::Order::back;
  if (order == FrameNumbers::Order::repeated) return nullptr;
  Slot* slot = find(sensor, taken, 1);
  if (slot) ++slot->arrived[sensor].frames, slot->arrived[sensor].last = number;
  return slot;
}

void Windows::add(const TagBlock& block) {
  // If tags are missing, a click after the gap must not be assigned to a start before the gap.
  if (block.lost_blocks > 0 || block.lost_items > 0) histogram_->forget_start();
  const ClockFit& clock = clocks_[Sensor::spd];
  const Tag* const end = block.tags.data() + block.tags.size();
  const auto taken = [&](const Tag& first) {
    const Tag* const event = std::find_if(&first, end, std::mem_fn(&Tag::is_time_tag));
    return event == end ? block.received
                        : clock.taken(static_cast<std::uint64_t>(event->time_ps), block.received);
  };
  // Tags of a lost block are estimated by the mean size of the received blocks.
  if (!block.tags.empty()) ++blocks_, block_tags_ += block.tags.size();
  const double block_size =
      static_cast<double>(block_tags_) / static_cast<double>(std::max<std::uint64_t>(blocks_, 1));
  const auto lost =
      std::llround(static_cast<double>(block.lost_blocks) * std::max(1.0, block_size));
  const HostTime reported = block.tags.empty() ? block.received : taken(block.tags.front());
  add_lost(Sensor::spd, reported, static_cast<std::uint64_t>(lost) + block.lost_items,
           block.lost_blocks);
  for (auto rest = block.tags; !rest.empty();) {
    const HostTime from = taken(rest.front());
    const std::int64_t k = grid_.slot_of(from);
    const auto border = std::partition_point(
        rest.begin(), rest.end(), [&](const Tag& t) { return grid_.slot_of(taken(t)) <= k; });
    const auto part = rest.first(static_cast<std::size_t>(border - rest.begin()));
    add_part(part, from, std::max(from, std::min(taken(part.back()), grid_.end(k))));
    rest = rest.subspan(part.size());
  }
}

// Adds tags that belong to one slot. `from` and `to` are the times of the first and the last tag.
void Windows::add_part(std::span<const Tag> tags, HostTime from, HostTime to) {
  Slot* slot = find(Sensor::spd, from, tags.size());
  if (!slot) return histogram_->forget_start();
  if (!slot->histogram) slot->histogram = std::make_shared<tdc::Histogram>(histogram_->settings());
  if (slot->histogram != histogram_) slot->histogram->follow(*histogram_);
  histogram_ = slot->histogram;
  histogram_->add(tags);
  if (!histogram_->in_overflow())
    overflow_from_.reset();
  else if (!overflow_from_)
    overflow_from_ = to;
  slot->arrived[Sensor::spd].times.add(from, to, grid_.centre(grid_.slot_of(from)),
                                       static_cast<double>(tags.size()));
}

void Windows::add(const HistogramFrame& frame) {
  const HostTime end = clocks_[Sensor::spd].taken(device_clock_of(frame), frame.received);
  const HostTime begin = end - std::chrono::microseconds(frame.exposure_us);
  const HostTime middle = begin + (end - begin) / 2;
  add_lost(Sensor::spd, middle, frame.lost_before);
  const std::uint64_t clicks = frame.clicks();
  Slot* slot = find(Sensor::spd, middle, frame.pulses + clicks);
  if (!slot) return;
  if (refused_[Sensor::spd]) {
    ++slot->arrived[Sensor::spd].lost, slot->arrived[Sensor::spd].fault = axis_changed;
    return;
  }
  slot->summed.resize(frame.counts.size());
  for (std::size_t i = 0; i < frame.counts.size(); ++i)
    slot->summed[i] += std::min(frame.counts[i], UINT32_MAX - slot->summed[i]);
  slot->summed_tags += {.tags = frame.pulses + clicks, .starts = frame.pulses, .in_range = clicks};
  slot->arrived[Sensor::spd].times.add(begin, end, grid_.centre(grid_.slot_of(middle)));
}

void Windows::add(const RadarFrame& frame) {
  const HostTime taken = clocks_[Sensor::radar].taken(frame.time_cpu_cycles, frame.received);
  Slot* slot =
      add_frame(Sensor::radar, taken, frame.lost_before, frame.frame_number, frame.time_cpu_cycles);
  if (!slot) return;
  if (frame.stats) slot->stats = frame.stats;
  if (frame.temperature) slot->temperature = frame.temperature;
  take_profile(*slot, frame, taken);
}

void Windows::take_profile(Slot& slot, const RadarFrame& frame, HostTime taken) {
  const auto axis = axes_.find("radar");
  const std::size_t bins = frame.power.size();
  Arrived& radar = slot.arrived[Sensor::radar];
  if (bins == 0) {
    radar.fault = {VerdictKind::no_profile, {}};
  } else if (refused_[Sensor::radar]) {
    radar.fault = axis_changed;
  } else if (axis == axes_.end() || axis->second.count != bins) {
    radar.fault = {VerdictKind::other_axis, "frames of " + std::to_string(bins) + " bins"};
  } else {
    slot.power.resize(bins);
    for (std::size_t i = 0; i < bins; ++i) slot.power[i] += double{frame.power[i]};
    take_array(slot, frame);
    radar.times.add(taken, taken, grid_.centre(grid_.slot_of(taken)));
  }
}

void Windows::take_array(Slot& slot, const RadarFrame& frame) const {
  const auto axis = axes_.find("array");
  if (axis == axes_.end()) return;
  const std::size_t antennas = record::antennas_of(axis->second), bins = axis->second.count;
  if (frame.array.size() < 2 * bins * antennas) return;
  std::vector<std::complex<float>> samples(bins * antennas);
  for (std::size_t i = 0; i < samples.size(); ++i)
    samples[i] = {static_cast<float>(frame.array[2 * i + 1]),
                  static_cast<float>(frame.array[2 * i])};
  if (!slot.array) slot.array.emplace(bins, antennas);
  if (frame.subframes > 1 || frame.frame_number != slot.array_last + 1) slot.array->skip();
  slot.array->add(samples);
  slot.array_last = frame.frame_number;
}

void Windows::add(DepthFrame frame) {
  const HostTime taken = clocks_[Sensor::depth].taken(frame.device_time_us, frame.received);
  Slot* slot =
      add_frame(Sensor::depth, taken, frame.lost_before, frame.frame_number, frame.device_time_us);
  if (!slot) return;
  Arrived& depth = slot->arrived[Sensor::depth];
  const auto x = axes_.find("depth_x"), y = axes_.find("depth_y");
  if (refused_[Sensor::depth]) {
    depth.fault = axis_changed;
  } else if (x == axes_.end() || y == axes_.end() || x->second.count != frame.width ||
             y->second.count != frame.height ||
             frame.depth_mm.size() != std::size_t{frame.width} * frame.height) {
    depth.fault = {VerdictKind::other_axis, "frames of " + size_of(frame.width, frame.height)};
  } else {
    const HostTime centre = grid_.centre(grid_.slot_of(taken));
    if (slot->depth && abs(depth.times.first - centre) <= abs(taken - centre)) return;
    slot->depth = std::move(frame);
    depth.times = {};
    depth.times.add(taken, taken, centre);
  }
}

record::Verdict Windows::spd_fault(const Slot& slot, HostTime end) const {
  const TagCounts tags = slot.tags();
  const Arrived& spd = slot.arrived[Sensor::spd];
  if (slot.summed.empty() && (refused_[Sensor::spd] || spd.fault.kind == VerdictKind::other_axis))
    return axis_changed;
  if (sends_histograms_ && slot.summed.empty())
    return {VerdictKind::no_histograms,
            spd.late > 0 ? "histograms arrived after their slot was closed" : ""};
  if (!sends_histograms_ && tags.tags == 0) return {VerdictKind::no_tags, {}};
  if (!sends_histograms_ && tags.starts == 0)
    return {VerdictKind::no_starts,
            "channel " + std::to_string(histogram_->settings().start_channel) +
                (tags.bad_tags > 0 ? "; " + std::to_string(tags.bad_tags) +
                                         " tags have an unknown type or a nonzero reserved byte"
                                   : "")};
  if (tags.in_range + tags.out_of_range == 0 && tags.without_start > 0) {
    if (overflow_from_)
      return {VerdictKind::in_overflow,
              "for " + std::to_string(std::llround(seconds(end - *overflow_from_))) +
                  " s; clicks are not counted until the tagger reports the end of the overflow"};
    if (tags.overflows > 0)
      return {VerdictKind::in_overflow,
              std::to_string(tags.overflows) + " overflows contain all clicks of the slot"};
  }
  const auto span = spd.times.last - spd.times.first;
  if (span < grid_.length / 2)
    return {VerdictKind::covers_part,
            (sends_histograms_ ? "histograms" : "tags") + std::string(" for ") +
                std::to_string(100 * span / grid_.length) + " % of the slot"};
  return ok_verdict;
}

record::Verdict Windows::fault_of(const Slot& slot, Sensor sensor, HostTime end) const {
  const Arrived& arrived = slot.arrived[sensor];
  if (sensor == Sensor::spd) return spd_fault(slot, end);
  if (arrived.times.count > 0) return ok_verdict;
  return arrived.frames > 0 ? arrived.fault : record::Verdict{VerdictKind::no_frames, {}};
}

void Windows::fill_spd(const Slot& slot, record::FusedRecord& record) const {
  TagCounts& c = record.spd_counts;
  c = slot.tags();
  c.lost_blocks = slot.lost_blocks;
  record::SensorSync& sync = record.sync[Sensor::spd];
  sync.arrived = sends_histograms_ ? sync.used : c.tags;
  sync.used = c.in_range;
  sync.lost += std::max(c.missed, c.overflows + c.errors);
  if (slot.histogram)
    record.signal.clicks_per_pulse =
        slot.histogram->gaps().clicks_per_pulse(c.in_range + c.out_of_range, c.starts);
  else if (c.starts > 0)
    record.signal.clicks_per_pulse =
        static_cast<double>(c.in_range) / static_cast<double>(c.starts);
  if (record.has(Sensor::spd)) record.spd = slot.histogram ? slot.histogram->counts() : slot.summed;
}

void Windows::fill_radar(Slot& slot, record::FusedRecord& record) {
  const std::uint64_t frames = record.sync[Sensor::radar].used;
  record.radar_stats = slot.stats;
  record.radar_temperature = slot.temperature;
  if (!record.has(Sensor::radar)) return;
  if (slot.array) {
    record.array_frames = slot.array->frames();
    record.array = slot.array->take();
  }
  for (const double sum : slot.power)
    record.radar.push_back(static_cast<float>(sum / static_cast<double>(frames)));
}

record::FusedRecord Windows::close(const DueSlot& due) {
  Slot slot;
  if (auto node = open_.extract(due.index)) slot = std::move(node.mapped());
  if (slot.histogram) slot.histogram->flush();
  next_ = due.index + 1;

  record::FusedRecord record;
  record.index = due.index;
  record.slot_start = grid_.start(due.index);
  record.slot_end = grid_.end(due.index);
  const Arrived &radar = slot.arrived[Sensor::radar], &depth = slot.arrived[Sensor::depth];
  record.statistics = {.radar_frames = radar.frames,
                       .depth_frames = depth.frames,
                       .radar_last = radar.last,
                       .depth_last = depth.last};
  for (const Sensor s : all_sensors) {
    const Arrived& arrived = slot.arrived[s];
    const auto span = arrived.times.last - arrived.times.first;
    record::SensorSync& sync = record.sync[s];
    sync.used = static_cast<std::uint64_t>(arrived.times.count);
    sync.lost = arrived.lost, sync.arrived = arrived.frames;
    arrived.times.describe(sync);
    record.clocks[s] = clocks_[s].state(grid_.centre(due.index));
    record::Verdict& verdict = sync.verdict;
    const record::Verdict fault = fault_of(slot, s, record.slot_end);
    // A stalled slot is treated as incomplete if its tags span less than 90 % of the slot, because
    // only a later sample would report lost tags.
    const bool cut = s == Sensor::spd && span < grid_.length * 9 / 10;
    if (!configured_.contains(s)) {
      verdict.kind = VerdictKind::not_configured;
    } else if (due.stalled && (!fault.ok() || !clocks_[s].sound() || cut)) {
      verdict.kind = VerdictKind::stood_still;
    } else if (!fault.ok()) {
      verdict = fault;
    } else {
      record.accept(s);
    }
  }
  record.missing = required_ - record.valid;
  fill_spd(slot, record);
  fill_radar(slot, record);
  if (record.has(Sensor::depth)) record.depth_mm = std::move(slot.depth->depth_mm);
  return record;
}

void Windows::finish() {
  histogram_->flush();
  for (const auto& [k, slot] : open_) {
    unassigned_.outside[Sensor::spd] += slot.tags().tags;
    for (const Sensor s : {Sensor::radar, Sensor::depth})
      unassigned_.outside[s] += slot.arrived[s].frames;
  }
  open_.clear();
}

}  // namespace echofuse::acquire
