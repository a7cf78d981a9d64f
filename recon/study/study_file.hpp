// SPDX-License-Identifier: MIT
// OUT/STUDY.csv: all that a study has measured, a row a condition, model and seed. Comments above
// the table say with what settings. A part of the study, which another process measures, has such a
// file of its own, OUT/STUDY-part-K-of-N.csv. Several of them, one behind the other, are one, too.
#pragma once
#include <cstdio>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "recon/study/study.hpp"

namespace echofuse::recon {

inline constexpr const char* no_machine = "-";

struct Measurement {
  std::string axis, value, model, inputs;  // where, and of what
  std::size_t seed = 0;
  std::map<std::string, double> metrics = {};  // by name; NaN: undefined
  std::string machine = no_machine;            // that its times were measured on

  auto key() const { return std::tie(axis, value, model, inputs, seed); }
  double metric(const std::string& name) const {
    const auto found = metrics.find(name);
    return found == metrics.end() ? std::numeric_limits<double>::quiet_NaN() : found->second;
  }
};

// All that measurements depend on and that is not in their key; the first is {"study", its name}.
using StudySettings = std::vector<std::pair<std::string, std::string>>;

class StudyFile {
 public:
  // Begins the file of the study, or of a part of it, or goes on with it; an incomplete line, which
  // a killed process leaves at the end, is cut off. Reads what the other files of the study in the
  // folder have. `metrics`: the columns of numbers. Throws Error: config for a file that is not of
  // this study, `refusal` for one of other settings, usage for a folder that holds other files of
  // the study's name, failed for a damaged file, disk.
  StudyFile(const StudyOptions& options, const StudySettings& settings,
            std::vector<std::string> metrics, ExitCode refusal);

  // It says whether it is measured, here or in another file; `timed`: with times.
  bool has(const Measurement& measurement, bool timed = false) const;
  // The same; a row that only a part of the study has is copied.
  bool take(const Measurement& measurement, bool timed = false);
  // Appends a row; it stays after a kill or a power loss. A later row of the same key replaces an
  // earlier one. Throws Error(interrupted) instead if the user interrupts, who may have cut the
  // measurement short; Error(disk).
  void add(const Measurement& measurement);
  std::vector<Measurement> all() const;  // of this file, by axis, value, model, inputs, seed

 private:
  using Key = std::tuple<std::string, std::string, std::string, std::string, std::size_t>;
  using Rows = std::map<Key, Measurement>;
  // Returns how many bytes are whole lines below a whole head; 0: the head is not whole yet.
  std::size_t read(const std::string& path, Rows& rows) const;
  bool parse(const std::string& line, Rows& rows) const;
  void append(const Measurement& measurement);
  void write(const std::string& text);

  std::vector<std::string> metrics_, head_;  // lines
  ExitCode refusal_;
  bool is_part_;
  std::string path_;
  Rows rows_, elsewhere_;
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_{nullptr, std::fclose};
};

}  // namespace echofuse::recon
