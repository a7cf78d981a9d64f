// SPDX-License-Identifier: MIT
#include "acquire/run_names.hpp"

#include <ctime>
#include <filesystem>

#include "drivers/core/exit_code.hpp"

namespace echofuse::acquire {
namespace {

std::filesystem::path with_extension(std::filesystem::path name) {
  if (!name.has_extension()) name += ".sqlite";
  return name;
}

}  // namespace

std::string old_run(const std::string& name) {
  return std::filesystem::is_regular_file(name) ? name : with_extension(name).string();
}

std::string new_run(const std::string& out) {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::string name(out.size() + 256, '\0');
  name.resize(std::strftime(name.data(), name.size(), out.c_str(), &utc));
  if (name.empty()) throw Error(ExitCode::usage, "--out " + out + ": not a name");
  return std::filesystem::absolute(with_extension(name)).string();
}

}  // namespace echofuse::acquire
