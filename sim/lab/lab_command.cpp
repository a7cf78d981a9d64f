// SPDX-License-Identifier: MIT
#include "sim/lab/lab_command.hpp"

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>

#include "drivers/program/console.hpp"
#include "drivers/program/program.hpp"

namespace echofuse::sim {
namespace {

void put_environment(const Lab& lab) {
  for (const auto& [name, value] : lab.environment()) ::setenv(name.c_str(), value.c_str(), 1);
  const char* path = std::getenv("PATH");
  ::setenv("PATH", (program_folder().string() + (path ? std::string(":") + path : "")).c_str(), 1);
}

}  // namespace

ExitCode serve_command(Lab& lab, const std::vector<std::string>& command, bool quiet) {
  const bool talks = !quiet && ::isatty(STDERR_FILENO) != 0;
  put_environment(lab);
  const auto started = start_program(command);
  if (!started) throw Error(ExitCode::failed, started.failure().text());
  const pid_t child = *started;
  if (talks)
    std::fprintf(stderr,
                 "the laboratory is open: lab.toml names its devices, and `%s` runs in it; leaving "
                 "that (exit) closes it\n",
                 command.front().c_str());
  int status = 0;
  bool told = false;
  lab.serve([&] {
    if (interrupted() && !std::exchange(told, true)) ::kill(child, SIGTERM);
    return ::waitpid(child, &status, WNOHANG) != 0;
  });
  if (talks)
    std::fputs("the laboratory is closed; nothing of its lab.toml answers any more\n", stderr);
  return static_cast<ExitCode>(WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status));
}

}  // namespace echofuse::sim
