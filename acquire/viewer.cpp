// SPDX-License-Identifier: MIT
#include "acquire/viewer.hpp"

#include <signal.h>
#include <spdlog/spdlog.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <vector>

#include "drivers/core/exit_code.hpp"
#include "drivers/core/program.hpp"

namespace echofuse::acquire {
namespace {

namespace fs = std::filesystem;
constexpr const char* name = "echofuse-view";

// The one beside this program, or one that PATH has.
std::string viewer_program() {
  std::error_code none;
  const fs::path beside = fs::read_symlink("/proc/self/exe", none).parent_path() / name;
  return fs::exists(beside, none) ? beside.string() : name;
}

}  // namespace

Viewer::Viewer(const std::string& run, std::optional<std::int64_t> planned) {
  std::vector<std::string> words{viewer_program(), run, "--until-closed"};
  if (planned) words.insert(words.end(), {"--planned", std::to_string(*planned)});
  const auto started = start_program(words);
  if (started)
    program_ = *started;
  else
    spdlog::warn("no view: {}", started.failure().text());
}

Viewer::~Viewer() {
  if (!program_) return;
  ::kill(*program_, SIGTERM);
  wait_for_program(*program_);
}

TemporaryFolder::TemporaryFolder() {
  std::error_code none;
  path_ = (fs::temp_directory_path(none) / "echofuse-align-XXXXXX").string();
  if (!::mkdtemp(path_.data()))
    throw Error(ExitCode::disk, path_ + ": cannot be made: " + std::strerror(errno));
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code none;
  fs::remove_all(path_, none);
}

}  // namespace echofuse::acquire
