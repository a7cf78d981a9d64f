// SPDX-License-Identifier: MIT
// The rows of a run beside its records.
#include "acquire/record/insert.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/writer_lock.hpp"

namespace echofuse::record {

// Room for the row of the run, configuration included, and the index file of a reader.
void RunWriter::reserve() const { lock_->reserve(128 << 10); }

void RunWriter::put_axis(const Axis& axis) {
  rows()
      .into("axis")
      .set("name", axis.name)
      .set("quantity", axis.quantity)
      .set("unit", axis.unit)
      .set("count", axis.count)
      .set("start", axis.start)
      .set("step", axis.step)
      .set("scale", axis.scale)
      .run();
  axes_.push_back(axis);
}

void RunWriter::put_device(const DeviceInfo& device) {
  rows()
      .into("device")
      .set("sensor", name_of(device.sensor))
      .set("address", device.address)
      .set("model", device.model)
      .set("serial", device.serial)
      .set("firmware", device.firmware)
      .run();
}

void RunWriter::put_calibration(const CalibrationEntry& entry) {
  rows()
      .into("calibration")
      .set("sensor", name_of(entry.sensor))
      .set("date_utc", entry.date_utc)
      .set("method", entry.method)
      .set("distance_m", entry.distance_m)
      .set("offset_m", entry.offset_m)
      .set("standard_error_m", entry.standard_error_m)
      .run();
}

void RunWriter::put_policy(Sensor sensor, const std::string& policy) {
  rows()
      .into("policy", "ON CONFLICT (sensor) DO UPDATE SET policy = excluded.policy")
      .set("sensor", name_of(sensor))
      .set("policy", policy)
      .run();
}

void RunWriter::put_counters(std::span<const Counted> counters) {
  in_transaction([&] {
    for (const Counted& c : counters)
      rows_->into("counter")
          .set("source", c.source)
          .set("name", c.name)
          .set("value", c.value)
          .set("part", part_)
          .run();
  });
}

void RunWriter::put_late(std::int64_t first, const LateCounts& late) {
  in_transaction([&] {
    Insert& row =
        rows_->into("late",
                    "ON CONFLICT (idx) DO UPDATE SET spd = spd + excluded.spd, radar = radar + "
                    "excluded.radar, depth = depth + excluded.depth");
    for (const auto& [slot, counts] : late) {
      for (const Sensor s : all_sensors) row.set(name_of(s), counts[s]);
      row.set("idx", first + slot).run();
    }
  });
}

void RunWriter::put_anchor(HostTime mono, UtcTime utc) {
  rows()
      .into("anchor")
      .set("mono_ns", std::int64_t{mono.count()})
      .set("utc_ns", std::int64_t{utc.count()})
      .run();
}

void RunWriter::put_event(UtcTime utc, Severity severity, const std::string& source,
                          const std::string& text) {
  constexpr const char* levels[] = {"info", "warning", "error"};
  rows()
      .into("event")
      .set("utc", iso8601(utc))
      .set("level", levels[static_cast<std::size_t>(severity)])
      .set("source", source)
      .set("text", text)
      .run();
}

}  // namespace echofuse::record
