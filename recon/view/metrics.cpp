// SPDX-License-Identifier: MIT
#include <cinttypes>

#include "recon/numbers/text.hpp"
#include "recon/view/show.hpp"

namespace echofuse::view {

// A gauge whose value is not known has no line.
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
  if (const auto free = run_.path().empty() ? std::nullopt : run_.free_bytes())
    out +=
        "# HELP echofuse_disk_free_bytes Of the run's disk.\n"
        "# TYPE echofuse_disk_free_bytes gauge\n" +
        formatted("echofuse_disk_free_bytes %" PRIu64 "\n", *free);
  return out;
}

}  // namespace echofuse::view
