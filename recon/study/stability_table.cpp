// SPDX-License-Identifier: MIT
#include "recon/study/stability_table.hpp"

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "drivers/core/exit_code.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

// What a line begins with; no two lines may.
std::string key_of(const StabilityRow& r) {
  return r.kind + ',' + r.axis + ',' + r.value + ',' + r.model + ',' + r.inputs + ',' +
         std::to_string(r.seed);
}

std::string header() {
  std::string out = "kind,axis,value,model,inputs,seed";
  for (const Metric m : stability_metrics) out += std::string(",") + metric_names[m];
  return out;
}

std::string line_of(const StabilityRow& r) {
  std::string out = key_of(r);
  for (const double score : r.scores) out += std::isnan(score) ? ",nan" : formatted(",%.6g", score);
  return out;
}

StabilityRow row_of(const std::string& line, const std::string& where) {
  const auto cells = cells_of(line);
  StabilityRow row;
  if (cells.size() != 6 + row.scores.size())
    throw Error(ExitCode::failed, where + ": damaged line; remove it, and it is measured again");
  row.kind = cells[0], row.axis = cells[1], row.value = cells[2];
  row.model = cells[3], row.inputs = cells[4];
  row.seed = std::strtoul(cells[5].c_str(), nullptr, 10);
  for (std::size_t i = 0; i < row.scores.size(); ++i)
    row.scores[i] = std::strtod(cells[6 + i].c_str(), nullptr);
  return row;
}

}  // namespace

StabilityTable::StabilityTable(const std::string& folder, const std::string& settings)
    : folder_(folder), path_(folder + "/stability.csv") {
  make_folder(folder);
  if (std::filesystem::exists(path_)) {
    check_settings(settings);
    read();
  } else {
    const std::string beside = folder + "/settings.txt";
    if (std::filesystem::exists(beside) && read_text(beside) != settings)
      throw Error(ExitCode::usage, beside + ": is of something else; give another --out");
    if (std::filesystem::exists(folder + "/stability.html"))
      throw Error(ExitCode::usage, folder +
                                       "/stability.html: is of a study whose table is missing; "
                                       "give another --out");
    write_text(beside, settings);
    write_text(path_, header() + "\n");
  }
  out_.open(path_, std::ios::app);
  if (!out_) throw Error(ExitCode::disk, path_ + ": cannot be written");
}

bool StabilityTable::has(const StabilityRow& row) const { return known_.count(key_of(row)) > 0; }

void StabilityTable::add(const StabilityRow& row) {
  out_ << line_of(row) << std::endl;
  if (!out_) throw Error(ExitCode::disk, path_ + ": cannot be written");
  rows_.push_back(row);
  known_.insert(key_of(row));
}

void StabilityTable::check_settings(const std::string& settings) const {
  std::istringstream there(read_text(folder_ + "/settings.txt")), here(settings);
  std::string before, now, differ;
  while (std::getline(here, now)) {
    if (!std::getline(there, before)) before.clear();
    if (before != now) differ += (differ.empty() ? "" : ", ") + before + " (now: " + now + ")";
  }
  if (!differ.empty())
    throw Error(ExitCode::config, folder_ + ": was measured with " + differ +
                                      "; take the same settings or another folder");
}

void StabilityTable::read() {
  std::string text = read_text(path_);
  const std::size_t end = text.rfind('\n') + 1;  // 0 if there is none
  if (end < text.size()) std::filesystem::resize_file(path_, end);
  text.resize(end);
  std::istringstream in(text);
  std::string line;
  if (!std::getline(in, line) || line != header())
    throw Error(ExitCode::failed, path_ + ": is not the table of a study of stability");
  for (std::size_t number = 2; std::getline(in, line); ++number) {
    rows_.push_back(row_of(line, path_ + ":" + std::to_string(number)));
    known_.insert(key_of(rows_.back()));
  }
}

}  // namespace echofuse::recon
