// SPDX-License-Identifier: MIT
#include "recon/study/study_file.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <sstream>

#include "drivers/program/console.hpp"
#include "drivers/program/printable.hpp"
#include "drivers/program/regular_file.hpp"
#include "recon/data/files.hpp"

namespace echofuse::recon {
namespace {

// Names go into tables and pages.
bool is_name(const std::string& text) {
  return !text.empty() && text.size() < 100 && std::ranges::all_of(text, [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
           std::string_view(" ._+-").find(c) != std::string_view::npos;
  });
}

template <class Number>
bool is_number(const std::string& text, Number& out) {
  const char* const end = text.data() + text.size();
  const auto found = std::from_chars(text.data(), end, out);
  return found.ec == std::errc{} && found.ptr == end;
}

// Pages and charts of a study are its own, those of another one are not.
void refuse_foreign_files(const std::string& folder, const std::string& study) {
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().stem() == study)
      throw Error(ExitCode::usage, printable(entry.path().string()) + ": is of a study whose " +
                                       study + ".csv is missing; give another --out");
}

}  // namespace

StudyFile::StudyFile(const StudyOptions& options, const StudySettings& settings,
                     std::vector<std::string> metrics, ExitCode refusal)
    : metrics_(std::move(metrics)), refusal_(refusal), is_part_(options.part.has_value()) {
  for (const auto& [key, value] : settings) head_.push_back("# " + key + " " + printable(value));
  head_.emplace_back("axis,value,model,inputs,machine,seed");
  for (const auto& name : metrics_) head_.back() += "," + name;

  const std::string& study = settings[0].second;
  const std::string whole = options.out + "/" + study + ".csv";
  path_ = is_part_ ? options.out + "/" + study + "-" + options.part->name() + ".csv" : whole;
  make_folder(options.out);
  std::vector<std::string> others = part_files(options.out, study + "-", ".csv");
  if (is_part_ && std::filesystem::exists(whole)) others.push_back(whole);
  for (const auto& other : others)
    if (other != path_) read(other, elsewhere_);
  const bool begun = std::filesystem::exists(path_);
  if (!begun && !is_part_) refuse_foreign_files(options.out, study);
  const std::size_t size = begun ? read(path_, rows_) : 0;
  if (begun && size < std::filesystem::file_size(path_)) std::filesystem::resize_file(path_, size);
  file_.reset(std::fopen(path_.c_str(), "ae"));
  std::string head;
  for (const auto& line : head_) head += line + "\n";
  write(size == 0 ? head : "");
}

std::size_t StudyFile::read(const std::string& path, Rows& rows) const {
  std::istringstream in(RegularFile(path, ExitCode::failed).rest<std::string>());
  std::size_t bytes = 0, whole = 0, at = 0;  // at: the line of the head that must come next
  for (std::string line; std::getline(in, line);) {
    const bool cut = in.eof();
    bytes += line.size() + 1;
    if (at == head_.size() && line == head_[0]) at = 0;  // of the next of several files in one
    if (at < head_.size()) {
      if (cut && head_[at].starts_with(line)) break;
      if (line != head_[at] && at == 0)
        throw Error(ExitCode::config, printable(path) + ": is not the file of a study");
      if (line != head_[at])
        throw Error(refusal_, printable(path) + ": was measured with \"" + printable(line, 100) +
                                  "\" (now: \"" + printable(head_[at], 100) +
                                  "\"); give the same settings, or another folder");
      ++at;
    } else if (cut) {
      break;
    } else if (!parse(line, rows)) {
      throw Error(ExitCode::failed, printable(path) + ": damaged: \"" + printable(line, 100) +
                                        "\" is no row of a study");
    }
    if (at == head_.size()) whole = bytes;
  }
  return whole;
}

bool StudyFile::parse(const std::string& line, Rows& rows) const {
  constexpr std::size_t names = 5;
  std::vector<std::string> cells;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) cells.push_back(cell);
  Measurement m;
  if (cells.size() != names + 1 + metrics_.size() || !is_number(cells[names], m.seed) ||
      !std::all_of(cells.begin(), cells.begin() + names, is_name))
    return false;
  m.axis = cells[0], m.value = cells[1], m.model = cells[2], m.inputs = cells[3];
  m.machine = cells[4];
  for (std::size_t i = 0; i < metrics_.size(); ++i)
    if (!is_number(cells[names + 1 + i], m.metrics[metrics_[i]])) return false;
  rows.insert_or_assign(m.key(), m);
  return true;
}

bool StudyFile::has(const Measurement& m, bool timed) const {
  return std::ranges::any_of(std::array{&rows_, &elsewhere_}, [&](const Rows* rows) {
    const auto found = rows->find(m.key());
    return found != rows->end() && (!timed || found->second.machine != no_machine);
  });
}

bool StudyFile::take(const Measurement& m, bool timed) {
  if (!has(m, timed)) return false;
  if (!is_part_ && !rows_.contains(m.key())) append(elsewhere_.at(m.key()));
  return true;
}

void StudyFile::add(const Measurement& m) {
  if (interrupted()) throw Error(ExitCode::interrupted, "interrupted; the same command goes on");
  append(m);
  static_cast<void>(::fdatasync(::fileno(file_.get())));
}

void StudyFile::append(const Measurement& m) {
  std::string line = m.axis + ',' + m.value + ',' + m.model + ',' + m.inputs + ',' + m.machine +
                     ',' + std::to_string(m.seed);
  for (const auto& name : metrics_) {
    char text[32];  // the shortest that is read as the same number
    const double number = m.metric(name);
    char* const end = std::to_chars(text, text + sizeof text, number).ptr;
    line += ',' + (std::isnan(number) ? "nan" : std::string(&text[0], end));
  }
  write(line + '\n');
  rows_.insert_or_assign(m.key(), m);
}

// In one piece, so that two processes do not write into each other's lines.
void StudyFile::write(const std::string& text) {
  if (!file_ || std::fwrite(text.data(), 1, text.size(), file_.get()) != text.size() ||
      std::fflush(file_.get()) != 0)
    throw Error(ExitCode::disk, printable(path_) + ": cannot be written: " + std::strerror(errno));
}

std::vector<Measurement> StudyFile::all() const {
  std::vector<Measurement> out;
  for (const auto& [key, measurement] : rows_) out.push_back(measurement);
  return out;
}

}  // namespace echofuse::recon
