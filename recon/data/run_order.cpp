// SPDX-License-Identifier: MIT
#include "recon/data/run_order.hpp"

#include <algorithm>
#include <optional>

#include "acquire/record/data_set_part.hpp"
#include "acquire/record/run_file.hpp"
#include "acquire/record/run_parts.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::recon {
namespace {

bool is_part(const record::RunInfo& info) {
  return record::part_of_records(info) || record::part_of(info).number > 0;
}

struct Run {
  std::string path, data_set;  // data_set is its uuid; it is empty if the run is no part
  std::size_t place = 0;       // place of its data set among the paths
  std::int64_t first = 0, end = 0;
  std::optional<record::Corrections> corrections = {};  // corrections of a part
};

Run look_at(const std::string& path, std::size_t place) {
  const record::RunReader run(path);
  const record::RunInfo info = run.info();
  Run out{path, {}, place};
  if (!is_part(info)) return out;
  out.data_set = info.uuid;
  out.first = record::part_of(info).number > 0 ? info.first_index : record::first_index(run);
  out.end = out.first + run.count();
  out.corrections.emplace(run);
  return out;
}

}  // namespace

std::vector<std::string> in_order_of_records(const std::vector<std::string>& paths) {
  if (paths.size() < 2) return paths;
  std::vector<Run> runs;
  for (const auto& path : paths) {
    runs.push_back(look_at(path, runs.size()));
    Run& last = runs.back();
    for (const Run& run : runs)
      if (!last.data_set.empty() && run.data_set == last.data_set) {
        if (last.corrections != run.corrections)
          throw Error(ExitCode::failed, printable(path) + ": has another calibration than " +
                                            printable(run.path) + ", a part of the same data set");
        last.place = run.place;
        break;
      }
  }
  std::stable_sort(runs.begin(), runs.end(), [](const Run& a, const Run& b) {
    return a.place != b.place ? a.place < b.place : a.first < b.first;
  });
  std::vector<std::string> out;
  for (std::size_t i = 0; i < runs.size(); ++i) {
    if (i > 0 && runs[i].place == runs[i - 1].place && runs[i].first < runs[i - 1].end)
      throw Error(ExitCode::failed, printable(runs[i].path) + ": has records of " +
                                        printable(runs[i - 1].path) +
                                        ", too; give each part once, or they leak into the test");
    out.push_back(runs[i].path);
  }
  return out;
}

bool goes_on(const Dataset& data, const std::string& path, const record::RunInfo& info) {
  for (const auto& source : data.sources) {
    if (source.uuid != info.uuid) continue;
    if (&source == &data.sources.back() && is_part(info)) return true;
    throw Error(ExitCode::failed, printable(path) + ": the same run as " + printable(source.path) +
                                      "; give each run once, or its records leak into the test");
  }
  return false;
}

}  // namespace echofuse::recon
