// SPDX-License-Identifier: MIT
#include "acquire/run/viewer.hpp"

#include <signal.h>
#include <spdlog/spdlog.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <vector>

#include "drivers/util/exit_code.hpp"
#include "drivers/util/program.hpp"

namespace echofuse::acquire {

namespace fs = std::filesystem;

Viewer::Viewer(const std::string& run, std::optional<std::int64_t> planned,
               const std::string& model) {
  std::vector<std::string> words{sibling_program("echofuse-view"), run, "--until-closed"};
  if (planned) words.insert(words.end(), {"--planned", std::to_string(*planned)});
  if (!model.empty()) words.insert(words.end(), {"--model", model});
  const auto started = start_program(words);
  if (started)
    program_ = *started;
  else
    spdlog::warn("live view not started: {}", started.failure().text());
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
    throw Error(ExitCode::disk, path_ + ": cannot be created: " + std::strerror(errno));
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code none;
  fs::remove_all(path_, none);
}

}  // namespace echofuse::acquire
