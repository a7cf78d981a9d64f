// SPDX-License-Identifier: MIT
// This is what a report was made of, and by what; and paired differences.
#include <sys/utsname.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numeric>

#include "drivers/program/console.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"

namespace echofuse::recon {
namespace {

std::string now() {
  const std::time_t time = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&time, &utc);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%d %H:%M UTC", &utc);
  return text.data();
}

std::string host() {
  utsname names{};
  return uname(&names) == 0 ? std::string(names.nodename) + " (" + names.sysname + " " +
                                  names.release + ", " + names.machine + ")"
                            : "unknown";
}

// "2026-11-22T23:31:02.536Z" as now() writes it.
std::string minutes_of(const std::string& iso) {
  return iso.size() > 16 && iso[10] == 'T' ? iso.substr(0, 10) + " " + iso.substr(11, 5) + " UTC"
                                           : iso;
}

std::string photons_of(const Dataset& data) {
  std::vector<float> counts;
  for (std::size_t i = 0; i < data.size(); ++i)
    if (data.has(i, Sensor::spd)) {
      const auto row = data.spd.row(i);
      counts.push_back(std::accumulate(row.begin(), row.end(), 0.f));
    }
  if (counts.empty()) return "no detector";
  const auto at = [&](double share) { return static_cast<double>(quantile(counts, share)); };
  const double low = at(0.05), middle = at(0.5), high = at(0.95);
  return three_digits(middle) + " (median; 90 % of the records: " + three_digits(low) + " to " +
         three_digits(high) + ")";
}

std::string split_of(const ModelFacts& m) {
  return formatted(
      "%s; seed %llu, split seed %llu; its training: %zu records, %zu of validation, %zu held out "
      "(data CRC-32C %08x)",
      m.name.c_str(), static_cast<unsigned long long>(m.seed),
      static_cast<unsigned long long>(m.split_seed), m.train, m.validation, m.test, m.data_hash);
}

}  // namespace

std::vector<std::pair<std::string, std::string>> how_made(const ReportOptions& options,
                                                          const Report& report,
                                                          const Dataset* data) {
  std::vector<std::pair<std::string, std::string>> out{
      {"date", now()},
      {"program", std::string("echofuse ") + version()},
      {"host", host()},
      {"command", options.command}};
  const record::RunReader run(report.run);
  const record::RunInfo info = run.info();
  out.emplace_back("run",
                   report.run + formatted(", %lld records", static_cast<long long>(run.count())));
  out.emplace_back("run's uuid", info.uuid);
  std::string recorded = minutes_of(info.started_utc);
  if (!info.version.empty()) recorded += ", echofuse " + info.version;
  if (!info.host.empty()) recorded += ", on " + info.host;
  out.emplace_back("recorded", recorded + (report.simulated ? "; simulated" : ""));
  if (info.window_s > 0) out.emplace_back("length of a record", formatted("%g s", info.window_s));
  if (!info.operator_name.empty()) out.emplace_back("operator", info.operator_name);
  if (!info.notes.empty()) out.emplace_back("notes", info.notes);
  for (const auto& [key, value] : info.meta) out.emplace_back(key, value);
  if (data) {
    out.emplace_back("clicks a record", photons_of(*data));
    out.emplace_back(
        "maps", formatted("%u x %u pixels over \u00b1%.1f\u00b0", data->map.size, data->map.size,
                          180 / M_PI * std::atan(data->map.half_tangent)));
    out.emplace_back("data CRC-32C", formatted("%08x", data->hash));
  }
  if (!options.empty.empty()) out.emplace_back("empty room", options.empty);
  if (!report.room.empty()) out.emplace_back("another room", report.room);
  for (const ModeResult& mode : report.modes)
    for (const ModelFacts& m : mode.models) out.emplace_back("model " + m.file, split_of(m));
  return out;
}

}  // namespace echofuse::recon
