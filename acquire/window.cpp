// SPDX-License-Identifier: MIT
#include "acquire/window.hpp"

#include <utility>

#include "drivers/core/log2_codes.hpp"

namespace echofuse::acquire {
namespace {

constexpr const char* stood_still = "the program stood still";
constexpr const char* axis_changed = "axis differs from the one at the start of the run";

std::size_t at(Sensor s) { return static_cast<std::size_t>(s); }

// Adds counts of the same slot, taken at different times.
void merge(std::vector<std::uint32_t>& sum, std::vector<std::uint32_t> more) {
  if (sum.empty()) {
    sum = std::move(more);
    return;
  }
  for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += more[i];
}

void merge(tdc::TagCounts& sum, const tdc::TagCounts& more) {
  sum.tags += more.tags;
  sum.starts += more.starts;
  sum.in_range += more.in_range;
  sum.out_of_range += more.out_of_range;
  sum.without_start += more.without_start;
  sum.other += more.other;
  sum.missed += more.missed;
  sum.overflows += more.overflows;
  sum.errors += more.errors;
  sum.bad_tags += more.bad_tags;
  sum.backwards += more.backwards;
  sum.removed += more.removed;
}

std::string size_of(std::uint32_t width, std::uint32_t height) {
  return std::to_string(width) + " x " + std::to_string(height);
}

}  // namespace

void Windows::Receipts::add(HostTime received, HostTime centre) {
  if (count == 0 || received < first) first = received;
  if (count == 0 || received > last) last = received;
  from_centre += received - centre;
  ++count;
}

void Windows::Receipts::describe(record::SensorSync& sync) const {
  if (count == 0) return;
  sync.offset_s = seconds(from_centre) / static_cast<double>(count);
  sync.span_s = seconds(last - first);
}

Windows::Windows(const SlotGrid& grid, const tdc::HistogramSettings& tdc, std::uint32_t configured)
    : grid_(grid), configured_(configured), histogram_(tdc) {}

bool Windows::announce(const DeviceInfo& info) {
  bool fits = true;
  for (const auto& axis : info.axes) {
    const auto [known, is_new] = axes_.try_emplace(axis.name, axis);
    fits = fits && (is_new || same_axis(known->second, axis));
  }
  refused_[at(info.sensor)] = !fits;
  return fits;
}

std::vector<Axis> Windows::axes() const {
  std::vector<Axis> all;
  if (configured_ & 1u) all.push_back(histogram_.axis());
  for (const auto& [name, axis] : axes_) all.push_back(axis);
  return all;
}

// The open slot of a sample, or nothing if the sample is a stray of this many tags or frames.
Windows::Slot* Windows::find(Sensor sensor, HostTime received, std::uint64_t amount) {
  const std::int64_t k = grid_.slot_of(received);
  if (k >= next_) return &open_[k];
  (k < 0 ? strays_.outside : strays_.late)[at(sensor)] += amount;
  return nullptr;
}

void Windows::settle_tags() {
  histogram_.flush();
  const auto slot = open_.find(tag_slot_);
  if (slot == open_.end()) return;
  merge(slot->second.tags, histogram_.tag_counts());
  merge(slot->second.spd, histogram_.take());
}

void Windows::add(const TagBlock& block) {
  if (block.lost_blocks > 0 || block.lost_items > 0) tag_gap();
  Slot* slot = find(Sensor::spd, block.received, block.tags.size());
  if (!slot) {
    if (!block.tags.empty()) tag_gap();
    return;
  }
  const std::int64_t k = grid_.slot_of(block.received);
  if (k != tag_slot_) {
    settle_tags();
    tag_slot_ = k;
  }
  histogram_.add(block.tags);
  slot->spd_lost += block.lost_blocks + block.lost_items;
  slot->spd_receipts.add(block.received, grid_.centre(k));
}

void Windows::add(const RadarFrame& frame) {
  if (std::exchange(last_radar_number_, frame.frame_number) == frame.frame_number) {
    ++strays_.duplicate[at(Sensor::radar)];
    return;
  }
  Slot* slot = find(Sensor::radar, frame.received, 1);
  if (!slot) return;
  ++slot->radar_frames;
  slot->radar_last = frame.frame_number;
  slot->radar_lost += frame.lost_before;
  if (frame.stats) slot->stats = frame.stats;
  if (frame.temperature) slot->temperature = frame.temperature;
  const auto axis = axes_.find("radar");
  const std::size_t bins = frame.range_profile.size();
  if (bins == 0) {
    slot->radar_fault = "frames without a range profile";
  } else if (refused_[at(Sensor::radar)]) {
    slot->radar_fault = axis_changed;
  } else if (axis == axes_.end() || axis->second.count != bins) {
    slot->radar_fault = "frames of " + std::to_string(bins) + " bins do not fit the axis";
  } else {
    slot->power.resize(bins);
    for (std::size_t i = 0; i < bins; ++i)
      slot->power[i] += power_from_code(frame.range_profile[i], axis->second.scale);
    if (slot->radar_receipts.count == 0) slot->first_codes = frame.range_profile;
    slot->radar_receipts.add(frame.received, grid_.centre(grid_.slot_of(frame.received)));
  }
}

void Windows::add(DepthFrame frame) {
  const auto number = std::pair(frame.frame_index, frame.device_time_us);
  if (std::exchange(last_depth_number_, number) == number) {
    ++strays_.duplicate[at(Sensor::depth)];
    return;
  }
  Slot* slot = find(Sensor::depth, frame.received, 1);
  if (!slot) return;
  ++slot->depth_frames;
  slot->depth_last = frame.frame_index;
  slot->depth_lost += frame.lost_before;
  const auto x = axes_.find("depth_x"), y = axes_.find("depth_y");
  if (refused_[at(Sensor::depth)]) {
    slot->depth_fault = axis_changed;
  } else if (x == axes_.end() || y == axes_.end() || x->second.count != frame.width ||
             y->second.count != frame.height ||
             frame.depth_mm.size() != std::size_t{frame.width} * frame.height) {
    slot->depth_fault = "frames of " + size_of(frame.width, frame.height) + " do not fit the axes";
  } else {
    const HostTime centre = grid_.centre(grid_.slot_of(frame.received));
    const auto distance = [&](const DepthFrame& f) { return abs(f.received - centre); };
    if (!slot->depth || distance(frame) < distance(*slot->depth)) slot->depth = std::move(frame);
  }
}

std::string Windows::spd_fault(const Slot& slot) const {
  if (slot.tags.tags == 0) return "no tags";
  if (slot.tags.starts == 0)
    return "no start tags on channel " + std::to_string(histogram_.settings().start_channel);
  const auto span = slot.spd_receipts.last - slot.spd_receipts.first;
  if (span < grid_.length / 2)
    return "tags for only " + std::to_string(100 * span / grid_.length) + " % of the slot";
  return {};
}

std::string Windows::radar_fault(const Slot& slot) const {
  if (slot.radar_receipts.count > 0) return {};
  return slot.radar_frames > 0 ? slot.radar_fault : "no frames";
}

std::string Windows::depth_fault(const Slot& slot) const {
  if (slot.depth) return {};
  return slot.depth_frames > 0 ? slot.depth_fault : "no frames";
}

void Windows::fill_spd(Slot& slot, record::FusedRecord& record) const {
  const tdc::TagCounts& c = slot.tags;
  record.spd_counts = {.tags = c.tags,
                       .starts = c.starts,
                       .in_range = c.in_range,
                       .out_of_range = c.out_of_range,
                       .without_start = c.without_start,
                       .other = c.other,
                       .lost = std::max(c.missed, c.overflows + c.errors) + slot.spd_lost,
                       .missed = c.missed,
                       .overflows = c.overflows,
                       .errors = c.errors,
                       .bad_tags = c.bad_tags,
                       .backwards = c.backwards,
                       .removed = c.removed};
  record::SensorSync& sync = record.sync[at(Sensor::spd)];
  slot.spd_receipts.describe(sync);
  sync.used = c.in_range;
  sync.lost = record.spd_counts.lost;
  if (record.has(Sensor::spd)) record.spd = std::move(slot.spd);
}

void Windows::fill_radar(const Slot& slot, record::FusedRecord& record) const {
  const auto frames = slot.radar_receipts.count;
  record::SensorSync& sync = record.sync[at(Sensor::radar)];
  slot.radar_receipts.describe(sync);
  sync.used = static_cast<std::uint64_t>(frames);
  sync.lost = slot.radar_lost;
  record.radar_stats = slot.stats;
  record.radar_temperature = slot.temperature;
  if (!record.has(Sensor::radar)) return;
  if (frames == 1) {
    record.radar.assign(slot.first_codes.begin(), slot.first_codes.end());
    return;
  }
  const double antennas = axes_.at("radar").scale;
  for (const double sum : slot.power)
    record.radar.push_back(
        static_cast<float>(code_from_power(sum / static_cast<double>(frames), antennas)));
}

void Windows::fill_depth(Slot& slot, record::FusedRecord& record) const {
  record::SensorSync& sync = record.sync[at(Sensor::depth)];
  sync.lost = slot.depth_lost;
  if (!slot.depth) return;
  sync.used = 1;
  sync.offset_s = seconds(slot.depth->received - grid_.centre(record.index));
  if (record.has(Sensor::depth)) record.depth_mm = std::move(slot.depth->depth_mm);
}

record::FusedRecord Windows::close(const DueSlot& due) {
  if (due.index == tag_slot_) settle_tags();
  Slot slot;
  if (auto node = open_.extract(due.index)) slot = std::move(node.mapped());
  next_ = due.index + 1;

  record::FusedRecord record;
  record.index = due.index;
  record.slot_start = grid_.start(due.index);
  record.slot_end = grid_.end(due.index);
  record.books = {.radar_frames = slot.radar_frames,
                  .depth_frames = slot.depth_frames,
                  .radar_last = slot.radar_last,
                  .depth_last = slot.depth_last};
  const std::string faults[] = {spd_fault(slot), radar_fault(slot), depth_fault(slot)};
  for (const Sensor s : {Sensor::spd, Sensor::radar, Sensor::depth}) {
    std::string& verdict = record.sync[at(s)].verdict;
    if (!((configured_ >> at(s)) & 1u)) {
      verdict = "not configured";
    } else if (due.stalled) {
      verdict = stood_still;
    } else if (!faults[at(s)].empty()) {
      verdict = faults[at(s)];
    } else {
      verdict = "ok";
      record.set_valid(s);
    }
  }
  fill_spd(slot, record);
  fill_radar(slot, record);
  fill_depth(slot, record);
  return record;
}

void Windows::finish() {
  settle_tags();
  for (const auto& [k, slot] : open_) {
    strays_.outside[at(Sensor::spd)] += slot.tags.tags;
    strays_.outside[at(Sensor::radar)] += slot.radar_frames;
    strays_.outside[at(Sensor::depth)] += slot.depth_frames;
  }
  open_.clear();
}

}  // namespace echofuse::acquire
