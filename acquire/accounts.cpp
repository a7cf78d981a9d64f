// SPDX-License-Identifier: MIT
#include "acquire/accounts.hpp"

#include <string>
#include <utility>

#include "acquire/devices.hpp"

namespace echofuse::acquire {

void close_accounts(Writer& writer, RunLog& log, PerSensor<std::vector<Counter>> counters,
                    const Strays& strays) {
  for (const Sensor s : all_sensors) {
    counters[s].push_back({"early", strays.early[s]});
    counters[s].push_back({"late", strays.late[s]});
    counters[s].push_back({"outside", strays.outside[s]});
    counters[s].push_back({"duplicate", strays.duplicate[s]});
    counters[s].push_back({"out_of_order", strays.out_of_order[s]});
  }
  counters[Sensor::spd].push_back({"found", strays.found});
  std::vector<record::Counted> rows;
  for (const Sensor s : all_sensors)
    for (const Counter& c : counters[s]) rows.push_back({name_of(s), c.name, c.value});
  writer.put([rows = std::move(rows)](record::RunWriter& run) { run.put_counters(rows); });
  const auto count = [&](const char* what, const PerSensor<std::uint64_t>& n) {
    if (n != PerSensor<std::uint64_t>{})
      log.put(Severity::warning, "run",
              std::to_string(n[Sensor::spd]) + " tags, " + std::to_string(n[Sensor::radar]) +
                  " radar frames, " + std::to_string(n[Sensor::depth]) + " depth frames " + what);
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
