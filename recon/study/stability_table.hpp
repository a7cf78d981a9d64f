// SPDX-License-Identifier: MIT
// The table of a study of stability, a file that grows line by line and survives a kill.
#pragma once
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include "recon/study/stability.hpp"

namespace echofuse::recon {

class StabilityTable {
 public:
  // Reads what is there already; a last line that was cut off is dropped. Throws Error(config) if
  // FOLDER/settings.txt tells of other settings than these, Error(failed) for a damaged line,
  // Error(disk).
  StabilityTable(const std::string& folder, const std::string& settings);
  bool has(const StabilityRow& row) const;
  void add(const StabilityRow& row);  // throws Error(disk)
  const std::vector<StabilityRow>& rows() const { return rows_; }

 private:
  void check_settings(const std::string& settings) const;
  void read();

  std::string folder_, path_;
  std::vector<StabilityRow> rows_;
  std::set<std::string> known_;
  std::ofstream out_;
};

}  // namespace echofuse::recon
