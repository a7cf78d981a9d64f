// SPDX-License-Identifier: MIT
#include <cinttypes>

#include "drivers/program/printable.hpp"
#include "recon/numbers/text.hpp"
#include "recon/view/show.hpp"

namespace echofuse::view {
namespace {

// A verdict as a label's value: what could end it is left out.
std::string label_of(const std::string& kind) {
  std::string out = printable(kind, 60);
  std::erase_if(out, [](char c) { return c == '"' || c == '\\'; });
  return out;
}

}  // namespace

// Of a gauge whose value is not known there is no line.
std::string Show::metrics() const {
  using recon::formatted;
  const UtcTime now = clock_.utc();
  std::string out =
      "# HELP echofuse_records_total Records of the run.\n# TYPE echofuse_records_total counter\n" +
      formatted("echofuse_records_total %zu\n", run_.outlines().size()) +
      "# HELP echofuse_run_live 1 while the run is being recorded.\n"
      "# TYPE echofuse_run_live gauge\n" +
      formatted("echofuse_run_live %d\n", run_.live() && run_.trouble().empty() ? 1 : 0) +
      "# HELP echofuse_lost_total Tags, radar frames or depth frames that no record holds: lost on "
      "the way, or late for their slot.\n# TYPE echofuse_lost_total counter\n";
  for (const Sensor s : all_sensors) {
    const SensorState& sensor = run_.sensors()[s];
    for (const auto& [reason, value] : {std::pair{"lost", sensor.lost}, {"late", sensor.late}})
      out += formatted("echofuse_lost_total{sensor=\"%s\",reason=\"%s\"} %" PRIu64 "\n", name_of(s),
                       reason, value);
  }
  const auto gauges = [&](const char* name, const char* help, const auto& value_of) {
    out += formatted("# HELP %s %s\n# TYPE %s gauge\n", name, help, name);
    for (const Sensor s : all_sensors)
      if (const std::optional<double> v = value_of(run_.sensors()[s]))
        out += formatted("%s{sensor=\"%s\"} %.9g\n", name, name_of(s), *v);
  };
  gauges("echofuse_sensor_valid", "1 if the sensor is valid in the last record.",
         [](const SensorState& s) { return std::optional<double>(s.valid ? 1 : 0); });
  gauges("echofuse_sensor_age_seconds", "Since the end of the sensor's last valid slot.",
         [&](const SensorState& s) { return age_s(s, now); });
  gauges("echofuse_clock_residual_seconds", "Residual of the fit of the device's clock.",
         [](const SensorState& s) { return s.residual_s; });
  gauges("echofuse_sensor_rate_hz", "Clicks or frames used of the last record, by its window.",
         [&](const SensorState& s) {
           return run_.info().window_s > 0 ? std::optional<double>(s.used / run_.info().window_s)
                                           : std::nullopt;
         });
  out +=
      "# HELP echofuse_verdict_total Records by the verdict on a sensor.\n"
      "# TYPE echofuse_verdict_total counter\n";
  for (const Sensor s : all_sensors)
    for (const auto& [kind, records] : run_.verdicts().verdicts[s])
      out += formatted("echofuse_verdict_total{sensor=\"%s\",verdict=\"%s\"} %" PRId64 "\n",
                       name_of(s), label_of(kind).c_str(), records);
  out +=
      "# HELP echofuse_doubtful_total Records with a verdict other than ok.\n"
      "# TYPE echofuse_doubtful_total counter\n" +
      formatted("echofuse_doubtful_total %" PRId64 "\n", run_.verdicts().doubtful);
  if (!run_.temperatures().empty())
    out +=
        "# HELP echofuse_temperature_celsius Of the radar chip, by its place.\n"
        "# TYPE echofuse_temperature_celsius gauge\n";
  for (const auto& [place, degrees] : run_.temperatures())
    out += formatted("echofuse_temperature_celsius{sensor=\"radar\",place=\"%s\"} %d\n",
                     place.c_str(), degrees);
  if (const auto free = run_.path().empty() ? std::nullopt : run_.free_bytes())
    out +=
        "# HELP echofuse_disk_free_bytes Of the run's disk.\n"
        "# TYPE echofuse_disk_free_bytes gauge\n" +
        formatted("echofuse_disk_free_bytes %" PRIu64 "\n", *free);
  return out;
}

}  // namespace echofuse::view
