// SPDX-License-Identifier: MIT
#include "acquire/journal.hpp"

#include <utility>

namespace echofuse::acquire {
namespace {

constexpr auto anchor_pause = std::chrono::minutes(1);

}  // namespace

Journal::Journal(Writer& writer, const Clock& clock, const std::vector<Axis>& begun_axes)
    : writer_(writer), clock_(clock) {
  for (const Axis& axis : begun_axes) axes_.insert(axis.name);
  put_anchor();
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

void Journal::put_anchor() {
  anchor_mono_ = clock_.now();
  anchor_utc_ = clock_.utc();
  writer_.put([mono = anchor_mono_, utc = anchor_utc_](record::RunWriter& run) {
    run.put_anchor(mono, utc);
  });
}

void Journal::refresh_anchor(HostTime now) {
  if (now - anchor_mono_ >= anchor_pause) put_anchor();
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
  counters[Sensor::spd].push_back({"found", unassigned.found});
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
