// SPDX-License-Identifier: MIT
#include <nlohmann/json.hpp>

#include "acquire/commands/commands.hpp"
#include "acquire/measurement/verdict.hpp"

namespace echofuse::acquire {
namespace {

using Json = nlohmann::ordered_json;

std::string sensors_of(const record::VerdictRow& row) {
  std::string out;
  for (const Sensor s : all_sensors)
    if (row.sensors.contains(s)) out.append(out.empty() ? "" : ", ").append(name_of(s));
  return out;
}

const char* yes(bool is) { return is ? "yes" : "no"; }

}  // namespace

std::string describe_verdicts(bool json) {
  std::string out =
      "| verdict | sensors | valid data | input of models | ground truth | doubtful | meaning | "
      "limit |\n|---|---|---|---|---|---|---|---|\n";
  Json list = Json::array();
  for (const record::VerdictRow& row : record::verdict_table()) {
    const std::string sensors = sensors_of(row), setting = row.setting;
    list.push_back({{"word", row.word},
                    {"sensors", sensors},
                    {"valid", row.valid},
                    {"trains", row.trains},
                    {"truth", row.truth},
                    {"doubtful", row.doubtful},
                    {"lamp", record::name_of(row.lamp)},
                    {"setting", setting},
                    {"meaning", row.sentence}});
    out += "| `" + std::string(row.word) + "` | " + sensors + " | " + yes(row.valid) + " | " +
           yes(row.trains) + " | " + yes(row.truth) + " | " + yes(row.doubtful) + " | " +
           row.sentence + " | " + (setting.empty() ? "" : "`" + setting + "`") + " |\n";
  }
  return json ? Json{{"schema", 1}, {"verdicts", list}}.dump() + "\n" : out;
}

}  // namespace echofuse::acquire
