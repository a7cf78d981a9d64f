// SPDX-License-Identifier: MIT
// OUT/study.sqlite: with what settings a study measures, and all that it has measured. It belongs
// to the study, and so does what bears the study's name beside it: exports, which are never read.
// OUT/part-K-of-N.sqlite is the same of a part of the study, which another process measures.
//   PRAGMA application_id = 0x45434653 ("ECFS")
//   setting: key, value | measurement: a row a metric; score NULL: undefined
//   machine: on which the costs (times) of a measurement were taken; a part takes none
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
#include "drivers/core/staged_file.hpp"
#include "recon/study/study.hpp"

namespace echofuse::record {
class Statement;
}

namespace echofuse::recon {

struct Measurement {
  std::string axis, value, model, inputs;  // where, and of what
  std::size_t seed = 0;
  std::map<std::string, double> metrics = {};  // by name; NaN: undefined
  std::string machine = {};                    // that its costs are of; empty: it has none

  auto key() const { return std::tie(axis, value, model, inputs, seed); }
  double metric(const std::string& name) const {
    const auto found = metrics.find(name);
    return found == metrics.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
  }
};

// All that measurements depend on and that is not in their key; the first is {"study", its name}.
using StudySettings = std::vector<std::pair<std::string, std::string>>;

// Files come from elsewhere: nothing in them runs, and what reading may cost is bounded by their
// size. Measurements are kept as soon as they are added, also after a kill or a power loss; those
// of a part from finish() on.
class StudyFile {
 public:
  // Begins the study or goes on with it, beside what its parts have. Throws
  // Error: config for a file that is no study, `refusal` for one of other settings, usage for a
  // folder that holds files of the study's name without it, failed for a damaged one, disk.
  StudyFile(const StudyOptions& options, const StudySettings& settings, ExitCode refusal);

  // Whether it is measured: with any metrics, or with this one.
  bool has(const Measurement& measurement, const std::string& metric = {});
  // What a part has is kept now, so that all() has the order of the asking.
  void keep(const Measurement& measurement);
  // In one transaction; what is there already stays. Throws Error(interrupted) instead if the user
  // interrupts, who may have cut it short; Error(disk).
  void add(std::span<const Measurement> measurements);
  // Of a part: puts its file into the folder, over the one that may be there; nothing can be asked
  // any more. Else nothing.
  void finish();
  // In the order of their making or keeping. Throws Error(failed) for names that the program does
  // not write.
  std::vector<Measurement> all();

 private:
  struct Place {
    std::string path;
    std::unique_ptr<StagedFile> staged;  // of a part
  };
  static Place place_of(const StudyOptions& options, const std::string& study);
  StudyFile(Place place, const StudySettings& settings, ExitCode refusal, int flags);
  void begin(const StudySettings& settings);
  void check(const StudySettings& settings, ExitCode refusal);
  std::vector<Measurement> stored();
  record::Statement ask(const char* sql);
  void limit();
  Place place_;
  const std::string& path_ = place_.path;
  record::Budget budget_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> db_;
  using Key = std::tuple<std::string, std::string, std::string, std::string, std::size_t>;
  std::map<Key, Measurement> elsewhere_;  // in parts
  std::vector<Key> order_;                // in which it was found there
  std::vector<Measurement> kept_;         // written with what is added next
};

}  // namespace echofuse::recon
