// SPDX-License-Identifier: MIT
#include "recon/data/source_facts.hpp"

#include <charconv>
#include <cstdio>
#include <ctime>

namespace echofuse::recon {
namespace {

// Days since 1970 of "2026-01-31T12...", to the hour; nothing of another form.
std::optional<double> days_of(const std::string& utc) {
  std::tm t{};
  if (std::sscanf(utc.c_str(), "%4d-%2d-%2dT%2d", &t.tm_year, &t.tm_mon, &t.tm_mday, &t.tm_hour) !=
      4)
    return std::nullopt;
  t.tm_year -= 1900, t.tm_mon -= 1;
  return static_cast<double>(timegm(&t)) / 86400;
}

}  // namespace

std::optional<double> calibrated_days(const record::RunReader& run) {
  const auto started = days_of(run.info().started_utc);
  for (const auto& c : run.calibrations())
    if (const auto at = days_of(c.date_utc);
        c.sensor == Sensor::radar && at && started && *at <= *started)
      return *started - *at;
  return std::nullopt;
}

std::size_t laboratories_of(const record::RunReader& run) {
  std::size_t out = 0;
  for (const auto& [key, value] : run.info().meta)
    if (key == "laboratories") std::from_chars(value.data(), value.data() + value.size(), out);
  return out;
}

}  // namespace echofuse::recon
