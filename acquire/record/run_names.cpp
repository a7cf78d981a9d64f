// SPDX-License-Identifier: MIT
#include "acquire/record/run_names.hpp"

#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <string_view>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "drivers/util/regular_file.hpp"

namespace echofuse::record {

namespace {

namespace fs = std::filesystem;
constexpr const char* extension = ".sqlite";
// Supported time fields of strftime; %% is a percent sign.
constexpr std::string_view fields = "YmdHMSyjFT%";

// Returns an error message if a percent sign does not begin a supported field; otherwise an empty
// string.
std::string bad_field(const std::string& pattern) {
  for (std::size_t at = 0; (at = pattern.find('%', at)) != pattern.npos; at += 2)
    if (at + 1 == pattern.size() || fields.find(pattern[at + 1]) == fields.npos)
      return printable(pattern.substr(at, 2)) +
             " is not a supported time field; expected %Y, %m, %d, %H, %M, %S, %y, %j, %F or %T, "
             "or %% for a percent sign";
  return {};
}

std::string with_date(const std::string& pattern) {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::string name(pattern.size() + 256, '\0');
  name.resize(std::strftime(name.data(), name.size(), pattern.c_str(), &utc));
  return name;
}

// Returns FOLDER/STEM-NNN.sqlite, with NNN one above the highest existing number.
std::string numbered(const fs::path& folder, const std::string& stem) {
  const std::string begin = stem + "-";
  int last = 0;
  for (const fs::path& file : entries_of(folder)) {
    const std::string name = file.filename().string();
    if (name.starts_with(begin)) last = std::max(last, std::atoi(name.c_str() + begin.size()));
  }
  return (folder / (begin + format("%03d", last + 1) + extension)).string();
}

}  // namespace

std::string with_run_extension(const std::string& name) {
  return fs::path(name).extension() == extension ? name : name + extension;
}

std::string old_run(const std::string& name) {
  std::error_code unknown;  // RunReader reports the cause
  const auto found = fs::status(name, unknown);
  const bool is_there = fs::exists(found) && !fs::is_directory(found);
  return is_there ? name : with_run_extension(name);
}

std::string new_run(const std::string& out) {
  if (const std::string fault = bad_field(out); !fault.empty())
    throw Error(ExitCode::usage, "--out " + printable(out) + ": " + fault);
  const std::string name = with_date(out);
  const fs::path last = fs::path(name).filename();
  if (last.empty() || last == "." || last == "..")
    throw Error(ExitCode::usage, "--out " + printable(out) + ": expected the name of a run file");
  return fs::absolute(with_run_extension(name)).string();
}

std::string next_run(const std::string& folder) {
  const fs::path place = fs::absolute(folder.empty() ? "." : folder).lexically_normal();
  return numbered(place, with_date("%Y%m%d"));
}

std::string next_of(const std::string& out) {
  const fs::path path = new_run(out);
  if (out.find('%') != out.npos && !fs::exists(path)) return path;
  return numbered(path.parent_path(), path.stem());
}

}  // namespace echofuse::record
