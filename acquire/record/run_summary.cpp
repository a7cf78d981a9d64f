// SPDX-License-Identifier: MIT
#include <algorithm>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {
namespace {

// Returns true if a verdict of this kind makes a record doubtful.
bool is_doubt(const std::string& kind) {
  return kind != "ok" && kind != "not configured" && !kind.empty();
}

}  // namespace

std::string verdict_kind(const std::string& verdict) {
  return verdict.substr(0, verdict.find(':'));
}

void count_verdicts(RunSummary& sum, const PerSensor<std::string>& verdicts) {
  bool doubt = false;
  for (const Sensor s : all_sensors) {
    const std::string kind = verdict_kind(verdicts[s]);
    ++sum.verdicts[s][kind];
    doubt |= is_doubt(kind);
  }
  sum.doubtful += doubt;
}

std::string doubts_of(const RunSummary& sum) {
  constexpr PerSensor<const char*> names{"SPD", "radar", "camera"};
  std::string out;
  for (const Sensor s : all_sensors) {
    std::vector<std::pair<std::int64_t, std::string>> most;
    for (const auto& [kind, records] : sum.verdicts[s])
      if (is_doubt(kind)) most.emplace_back(-records, kind);
    std::sort(most.begin(), most.end());
    for (const auto& [records, kind] : most)
      out += (&kind != &most.front().second ? ", "
              : out.empty()                 ? std::string(names[s]) + " "
                                            : "; " + std::string(names[s]) + " ") +
             kind + " " + std::to_string(-records);
  }
  return out.empty() ? out
                     : std::to_string(sum.doubtful) + " of " + std::to_string(sum.records) +
                           " doubtful: " + out;
}

}  // namespace echofuse::record
