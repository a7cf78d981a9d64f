// SPDX-License-Identifier: MIT
// OUT/study.sqlite: with what settings a study measures, and all that it has measured. It belongs
// to the study, and so does what bears the study's name beside it: exports, which are never read.
//   PRAGMA application_id = 0x45434653 ("ECFS")
//   setting: key, value | measurement: a row a metric; score NULL: undefined
#pragma once
#include <limits>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "acquire/record/run_tables.hpp"
#include "recon/study/study.hpp"

namespace echofuse::record {
class Statement;
}

namespace echofuse::recon {

struct Measurement {
  std::string axis, value, model, inputs;  // where, and of what
  std::size_t seed = 0;
  std::map<std::string, double> metrics = {};  // by name; NaN: undefined

  auto key() const { return std::tie(axis, value, model, inputs, seed); }
  double metric(const std::string& name) const {
    const auto found = metrics.find(name);
    return found == metrics.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
  }
};

// All that measurements depend on and that is not in their key; the first is {"study", its name}.
using StudySettings = std::vector<std::pair<std::string, std::string>>;

// Files come from elsewhere: nothing in them runs, and what reading may cost is bounded by their
// size. Measurements are kept as soon as they are added, also after a kill or a power loss.
class StudyFile {
 public:
  // Begins the study or goes on with it, and takes what its parts have. Throws Error: config for a
  // file that is no study, `refusal` for one of other settings, usage for a folder that holds files
  // of the study's name without it, failed for a damaged one or a part that is not there, disk.
  StudyFile(const StudyOptions& options, const StudySettings& settings, ExitCode refusal);

  bool has(const Measurement& measurement);  // with any metrics
  // In one transaction; what is there already stays. Throws Error(interrupted) instead if the user
  // interrupts, who may have cut it short; Error(disk).
  void add(std::span<const Measurement> measurements);
  // In the order of their making. Throws Error(failed) for names that the program does not write.
  std::vector<Measurement> all();

 private:
  StudyFile(const std::string& path, const StudySettings& settings, ExitCode refusal, int flags);
  void begin(const StudySettings& settings);
  void check(const StudySettings& settings, ExitCode refusal);
  record::Statement ask(const char* sql);
  void limit();
  std::string path_;
  record::Budget budget_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> db_;
};

}  // namespace echofuse::recon
