// SPDX-License-Identifier: MIT
#include "acquire/run/journal.hpp"

#include <utility>

namespace echofuse::acquire {
namespace {

constexpr auto anchor_pause = std::chrono::minutes(1);
// What a program that sets the clock sets it by; the program itself may stand still for less
// between asking for both times.
constexpr auto least_step = std::chrono::milliseconds(500);

}  // namespace

Journal::Journal(Writer& writer, const Clock& clock, const std::vector<Axis>& begun_axes)
    : writer_(writer), clock_(clock) {
  for (const Axis& axis : begun_axes) axes_.insert(axis.name);
  anchors_.push_back(put_anchor());
}

void Journal::put_config(const Config& config, bool resumed) {
  for (const Sensor s : all_sensors)
    if (config.configured().contains(s))
      writer_.put(
          [s, policy = config.policy[s]](record::RunWriter& run) { run.put_policy(s, policy); });
  if (config.configured().contains(Sensor::depth)) {
    const auto map = config.map.axes();
    put_axes({map.begin(), map.end()});
  }
  if (resumed) return;
  if (!config.antennas.empty())
    writer_.put(
        [antennas = config.antennas](record::RunWriter& run) { run.put_antennas(antennas); });
  for (const auto& entry : config.calibration.entries)
    writer_.put([entry](record::RunWriter& run) { run.put_calibration(entry); });
}

void Journal::put_device(const DeviceInfo& device) {
  const std::string identity =
      device.address + '\n' + device.model + '\n' + device.serial + '\n' + device.firmware;
  if (std::exchange(identities_[device.sensor], identity) != identity)
    writer_.put([device](record::RunWriter& run) { run.put_device(device); });
}

void Journal::put_axes(const std::vector<Axis>& axes) {
  for (const Axis& axis : axes)
    if (axes_.insert(axis.name).second)
      writer_.put([axis](record::RunWriter& run) { run.put_axis(axis); });
}

Journal::Anchor Journal::put_anchor() {
  const HostTime mono = clock_.now();
  const UtcTime utc = clock_.utc();
  writer_.put([mono, utc](record::RunWriter& run) { run.put_anchor(mono, utc); });
  return {mono, utc - mono, mono};
}

void Journal::refresh_anchor(RunLog& log) {
  Anchor& last = anchors_.back();
  const HostTime now = clock_.now();
  const UtcTime before = now + last.utc_offset, utc = clock_.utc();
  if (std::chrono::abs(utc - before) >= least_step) {
    log.put(Severity::warning, "clock",
            "the machine's clock was set, or the machine slept: from " + iso8601(before) + " to " +
                iso8601(utc) + "; slots that begin from now on bear the new time");
    anchors_.push_back(put_anchor());
  } else if (now - last.mono >= anchor_pause) {
    const HostTime from = last.from;
    last = put_anchor();
    last.from = from;
  }
}

UtcTime Journal::utc_of(HostTime slot_start) {
  while (anchors_.size() > 1 && anchors_[1].from <= slot_start) anchors_.pop_front();
  return slot_start + anchors_.front().utc_offset;
}

void Journal::put_late(std::int64_t first, record::LateCounts late) {
  if (late.empty()) return;
  writer_.put(
      [first, late = std::move(late)](record::RunWriter& run) { run.put_late(first, late); });
}

void Journal::put_counters(PerSensor<std::vector<Counter>> counters,
                           const UnassignedSamples& unassigned) {
  for (const Sensor s : all_sensors) {
    counters[s].push_back({"early", unassigned.early[s]});
    counters[s].push_back({"late", unassigned.late[s]});
    counters[s].push_back({"outside", unassigned.outside[s]});
    counters[s].push_back({"duplicate", unassigned.duplicate[s]});
    counters[s].push_back({"out_of_order", unassigned.out_of_order[s]});
  }
  std::vector<record::Counted> rows;
  for (const Sensor s : all_sensors)
    for (const Counter& c : counters[s]) rows.push_back({name_of(s), c.name, c.value});
  writer_.put([rows = std::move(rows)](record::RunWriter& run) { run.put_counters(rows); });
}

void report_unassigned(RunLog& log, const UnassignedSamples& unassigned) {
  const auto count = [&](const char* what, const PerSensor<std::uint64_t>& n) {
    if (n != PerSensor<std::uint64_t>{})
      log.put(Severity::warning, "run",
              std::to_string(n[Sensor::spd]) + " tags, " + std::to_string(n[Sensor::radar]) +
                  " radar frames, " + std::to_string(n[Sensor::depth]) + " depth frames " + what);
  };
  count("came after their slot was closed", unassigned.late);
  count("came twice", unassigned.duplicate);
  count("came out of order", unassigned.out_of_order);
}

}  // namespace echofuse::acquire
