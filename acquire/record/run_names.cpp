// SPDX-License-Identifier: MIT
#include "acquire/record/run_names.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <string_view>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/printable.hpp"

namespace echofuse::record {

namespace {

constexpr const char* extension = ".sqlite";
// Fields of strftime; %% is a percent sign.
constexpr std::string_view fields = "YmdHMSyjFT%";

// Empty, or what is wrong: a percent sign that begins no field is not one of the name's letters.
std::string bad_field(const std::string& pattern) {
  for (std::size_t at = 0; (at = pattern.find('%', at)) != pattern.npos; at += 2)
    if (at + 1 == pattern.size() || fields.find(pattern[at + 1]) == fields.npos)
      return printable(pattern.substr(at, 2)) +
             " is no field of the time; expected %Y, %m, %d, %H, %M, %S, %y, %j, %F or %T, or %% "
             "for a percent sign";
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

}  // namespace

std::string with_run_extension(const std::string& name) {
  return std::filesystem::path(name).extension() == extension ? name : name + extension;
}

std::string old_run(const std::string& name) {
  const auto found = std::filesystem::status(name);
  const bool is_there = std::filesystem::exists(found) && !std::filesystem::is_directory(found);
  return is_there ? name : with_run_extension(name);
}

std::string new_run(const std::string& out) {
  if (const std::string fault = bad_field(out); !fault.empty())
    throw Error(ExitCode::usage, "--out " + printable(out) + ": " + fault);
  const std::string name = with_date(out);
  if (name.empty()) throw Error(ExitCode::usage, "--out " + out + ": not a name");
  return std::filesystem::absolute(with_run_extension(name)).string();
}

std::string next_run(const std::string& folder) {
  const std::string day = with_date("%Y%m%d-");
  const std::filesystem::path place = std::filesystem::absolute(folder.empty() ? "." : folder);
  int last = 0;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(place, error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(day)) last = std::max(last, std::atoi(name.c_str() + day.size()));
  }
  if (error) throw Error(ExitCode::disk, "run.folder: " + place.string() + ": " + error.message());
  char number[16];
  std::snprintf(number, sizeof number, "%03d", last + 1);
  return (place / (day + number + extension)).lexically_normal().string();
}

}  // namespace echofuse::record
