// SPDX-License-Identifier: MIT
#include "recon/data/run_order.hpp"

#include <algorithm>

#include "acquire/record/run_file.hpp"
#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::recon {
namespace {

struct Run {
  std::string path, uuid;
  std::size_t place = 0;  // place of the first file of this uuid among the paths
  std::int64_t first = 0, end = 0;
  // Corrections of ranges and angles, which a data set has once.
  std::vector<record::CalibrationEntry> offsets = {};
  record::Antennas antennas = {};
};

Run look_at(const std::string& path, std::size_t place) {
  const record::RunReader run(path);
  const record::RunInfo info = run.info();
  return {path,
          info.uuid,
          place,
          info.first_index,
          info.first_index + run.count(),
          run.calibrations(),
          run.antennas()};
}

}  // namespace

std::vector<std::string> in_order_of_records(const std::vector<std::string>& paths) {
  if (paths.size() < 2) return paths;
  std::vector<Run> runs;
  for (const auto& path : paths) {
    runs.push_back(look_at(path, runs.size()));
    Run& last = runs.back();
    for (const Run& run : runs)
      if (run.uuid == last.uuid) {
        if (last.offsets != run.offsets || last.antennas != run.antennas)
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

}  // namespace echofuse::recon
