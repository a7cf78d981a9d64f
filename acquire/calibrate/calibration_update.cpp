// SPDX-License-Identifier: MIT
#include "acquire/calibrate/calibration_update.hpp"

#include <cmath>
#include <cstdio>
#include <filesystem>

#include "acquire/calibrate/array_calibration.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/printable.hpp"

namespace echofuse::acquire {
namespace {

// Returns false if an antenna differs by more than four standard errors. The limit is higher than
// for a single value, because the largest of many differences is tested.
bool compare_antennas(const AntennaGains& now, const AntennaGains& then,
                      nlohmann::ordered_json& json, bool quiet) {
  if (now.empty()) return true;
  const bool same = now.gain.size() == then.gain.size();
  const double worst = largest_residual(now, then);
  const bool holds = same && worst <= 4;
  json["array_residual"] = {{"standard_errors", worst}, {"holds", holds}};
  if (!quiet && !same)
    std::printf(
        "array  the number of antennas differs from that of the stored calibration, %zu; calibrate "
        "again\n",
        then.gain.size());
  else if (!quiet)
    std::printf(
        "array  largest difference %.1f standard errors (limit 4): the calibration of %s %s\n",
        worst, then.date_utc.c_str(), holds ? "is valid" : "is outdated; calibrate again");
  return holds;
}

}  // namespace

bool compare(const Calibration& fresh, const Calibration& stored, nlohmann::ordered_json& json,
             bool quiet) {
  bool well = true;
  for (const auto& now : fresh.entries) {
    const auto* then = stored.find(now.sensor);
    if (!then) continue;
    const double residual = now.offset_m - then->offset_m;
    const double error = std::hypot(now.standard_error_m, then->standard_error_m);
    const bool holds = std::abs(residual) <= 3 * error;
    well = well && holds;
    json["residuals"].push_back({{"sensor", name_of(now.sensor)},
                                 {"residual_m", residual},
                                 {"standard_error_m", error},
                                 {"holds", holds}});
    if (!quiet)
      std::printf("%-6s residual %+.2f mm +- %.2f mm: the calibration of %s %s\n",
                  name_of(now.sensor), 1e3 * residual, 1e3 * error, then->date_utc.c_str(),
                  holds ? "is valid" : "is outdated; calibrate again");
  }
  return compare_antennas(fresh.antennas, stored.antennas, json, quiet) && well;
}

Calibration stored_in(const std::string& path) {
  std::error_code none;
  if (!std::filesystem::exists(path, none)) return {};
  try {
    return read_calibration(path);
  } catch (const Error& e) {
    throw Error(e.code(), std::string(e.what()) + "\n" + path +
                              " is not overwritten; remove it or set another run.calibration");
  }
}

void store(const Calibration& fresh, const Calibration& stored, const std::string& path,
           nlohmann::ordered_json& json, bool quiet) {
  write_calibration(path, fresh.over(stored));
  json["file"] = path;
  for (const auto& e : stored.entries) {
    if (fresh.find(e.sensor)) continue;
    json["kept"].push_back(
        {{"sensor", name_of(e.sensor)}, {"offset_m", e.offset_m}, {"date_utc", e.date_utc}});
    if (!quiet)
      std::printf("%-6s kept: offset %+.2f mm, measured %s\n", name_of(e.sensor), 1e3 * e.offset_m,
                  e.date_utc.c_str());
  }
  if (!quiet) std::printf("written to %s\n", printable(path).c_str());
}

}  // namespace echofuse::acquire
