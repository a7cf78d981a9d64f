// SPDX-License-Identifier: MIT
#include "acquire/record/run_names.hpp"

#include <ctime>
#include <filesystem>

#include "drivers/core/exit_code.hpp"

namespace echofuse::record {

std::string with_run_extension(const std::string& name) {
  return std::filesystem::path(name).has_extension() ? name : name + ".sqlite";
}

std::string old_run(const std::string& name) {
  return std::filesystem::is_regular_file(name) ? name : with_run_extension(name);
}

std::string new_run(const std::string& out) {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::string name(out.size() + 256, '\0');
  name.resize(std::strftime(name.data(), name.size(), out.c_str(), &utc));
  if (name.empty()) throw Error(ExitCode::usage, "--out " + out + ": not a name");
  return std::filesystem::absolute(with_run_extension(name)).string();
}

}  // namespace echofuse::record
