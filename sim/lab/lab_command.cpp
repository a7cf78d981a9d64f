// SPDX-License-Identifier: MIT
#include "sim/lab/lab_command.hpp"

#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "drivers/core/console.hpp"

namespace echofuse::sim {
namespace {

void put_environment(const Lab& lab) {
  for (const auto& [name, value] : lab.environment()) ::setenv(name.c_str(), value.c_str(), 1);
  const auto folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  const char* path = std::getenv("PATH");
  ::setenv("PATH", (folder.string() + (path ? std::string(":") + path : "")).c_str(), 1);
}

pid_t spawn(const std::vector<std::string>& command) {
  std::vector<char*> words;
  for (const auto& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  // An open port of the laboratory's in the child's hands would outlive its unplugging.
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  pid_t child = 0;
  const int error = ::posix_spawnp(&child, words[0], &actions, nullptr, words.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  if (error != 0)
    throw Error(ExitCode::failed, command[0] + ": cannot start: " + std::strerror(error));
  return child;
}

}  // namespace

ExitCode serve_command(Lab& lab, const std::vector<std::string>& command) {
  put_environment(lab);
  const pid_t child = spawn(command);
  int status = 0;
  bool told = false;
  lab.serve([&] {
    if (interrupted() && !std::exchange(told, true)) ::kill(child, SIGTERM);
    return ::waitpid(child, &status, WNOHANG) != 0;
  });
  return static_cast<ExitCode>(WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status));
}

}  // namespace echofuse::sim
