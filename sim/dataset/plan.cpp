// SPDX-License-Identifier: MIT
// Binds the settings of a plan to their keys, and resolves its twin.
#include <algorithm>

#include "sim/dataset/generator.hpp"
#include "sim/twin/twin.hpp"

namespace echofuse::sim {

void bind(Settings& settings, Plan& plan) {
  settings.add("seed", plan.seed, 0, INT64_MAX,
               "random seed; the same seed and settings give the same records");
  settings.add("people", plan.people, 0, 10'000'000, "number of records that show one person");
  settings.add("letters", plan.letters, 0, 10'000'000,
               "number of records that show a person holding a letter");
  settings.add("two_people", plan.two_people, 0, 10'000'000,
               "number of records that show two people");
  settings.add("empty", plan.empty, 0, 10'000'000, "number of records that show the empty room");
  settings.add("objects", plan.objects, 0, 10'000'000, "number of records that show the object");
  settings.add("scenes", plan.scenes,
               "TOML file with [[scene]] tables, which replace the numbers of records");
  settings.add("twin", plan.twin,
               "parameter ranges of the simulated laboratories (digital twin), one of: `default`, "
               "the name of a TOML file, TOML text");
  settings.add("laboratory", plan.laboratory, 0, INT64_MAX,
               "number that identifies the simulated laboratory; its parameters are sampled from "
               "the ranges of twin");
  settings.add("laboratories", plan.laboratories, 0, 1'000'000,
               "number of simulated laboratories; record i comes from laboratory (i modulo this "
               "number); 0: one laboratory");
  bind(settings, plan.conditions);
}

void resolve_twin(const Settings& settings, Plan& plan) {
  if (plan.twin.empty()) {
    for (const char* key : {"laboratory", "laboratories"})
      if (settings.given(key) && (plan.laboratory > 0 || plan.laboratories > 0))
        throw Error(
            ExitCode::config,
            std::string(key) +
                " needs a twin with parameter ranges; set twin = \"default\" or a file name");
    return;
  }
  if (plan.laboratories > 0 && plan.laboratory > 0)
    throw Error(ExitCode::config,
                "laboratory cannot be combined with laboratories; remove one of the two settings");
  Twin twin = twin_named(plan.twin);
  twin.ranges.erase(
      std::remove_if(twin.ranges.begin(), twin.ranges.end(),
                     [&](const KeyRange& range) { return settings.given(range.key); }),
      twin.ranges.end());
  plan.twin = to_text(twin);
}

std::vector<Conditions> laboratories_of(const Plan& plan) {
  if (plan.twin.empty()) return {plan.conditions};
  const Twin twin = twin_named(plan.twin);
  if (plan.laboratories == 0) return {conditions_of(twin, plan.laboratory, plan.conditions)};
  std::vector<Conditions> all;
  for (std::int64_t k = 0; k < plan.laboratories; ++k)
    all.push_back(conditions_of(twin, k, plan.conditions));
  return all;
}

}  // namespace echofuse::sim
