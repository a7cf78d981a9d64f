// SPDX-License-Identifier: MIT
#include "acquire/accounts.hpp"

#include <string>
#include <utility>

#include "acquire/devices.hpp"

namespace echofuse::acquire {

void close_accounts(Writer& writer, RunLog& log,
                    std::array<std::vector<Counter>, sensor_count> counters, const Strays& strays) {
  for (const Sensor s : all_sensors) {
    const auto i = static_cast<std::size_t>(s);
    counters[i].push_back({"early", strays.early[i]});
    counters[i].push_back({"late", strays.late[i]});
    counters[i].push_back({"outside", strays.outside[i]});
    counters[i].push_back({"duplicate", strays.duplicate[i]});
    counters[i].push_back({"out_of_order", strays.out_of_order[i]});
  }
  counters[0].push_back({"found", strays.found});
  std::vector<record::Counted> rows;
  for (const Sensor s : all_sensors)
    for (const Counter& c : counters[static_cast<std::size_t>(s)])
      rows.push_back({name_of(s), c.name, c.value});
  writer.put([rows = std::move(rows)](record::RunWriter& run) { run.put_counters(rows); });
  const auto count = [&](const char* what, const std::array<std::uint64_t, sensor_count>& n) {
    if (n[0] + n[1] + n[2] > 0)
      log.put(Severity::warning, "run",
              std::to_string(n[0]) + " tags, " + std::to_string(n[1]) + " radar frames, " +
                  std::to_string(n[2]) + " depth frames " + what);
  };
  count("came after their slot was closed", strays.late);
  count("came twice", strays.duplicate);
  count("came out of order", strays.out_of_order);
}

std::string count_text(std::int64_t written, std::optional<std::int64_t> planned,
                       std::optional<std::int64_t> before) {
  std::string text = std::to_string(written);
  if (planned) text += " of " + std::to_string(*planned);
  text += " records";
  if (before) text += ", " + std::to_string(*before + written) + " in all";
  return text;
}

}  // namespace echofuse::acquire
