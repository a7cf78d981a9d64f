// SPDX-License-Identifier: MIT
#include <algorithm>

#include "acquire/record/run_file.hpp"

namespace echofuse::record {

void count_verdicts(RunSummary& sum, const PerSensor<Verdict>& verdicts) {
  for (const Sensor s : all_sensors) ++sum.verdicts[s][verdicts[s].kind];
  sum.doubtful += is_doubtful(verdicts);
}

std::string doubts_of(const RunSummary& sum) {
  constexpr PerSensor<const char*> names{"SPD", "radar", "camera"};
  std::string out;
  for (const Sensor s : all_sensors) {
    std::vector<std::pair<std::int64_t, std::string>> most;
    for (const auto& [kind, records] : sum.verdicts[s])
      if (const VerdictRow& row = row_of(kind); row.doubtful) most.emplace_back(-records, row.word);
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
