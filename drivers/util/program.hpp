// SPDX-License-Identifier: MIT
// Starts other programs and finds their files.
#pragma once
#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

#include "drivers/core/result.hpp"

namespace echofuse {

struct ProgramOptions {
  std::string folder{};  // working directory; empty: inherited
  int output = 1;        // file descriptor used as standard output
  // True: its own process group, input from /dev/null, output to stderr.
  bool background = false;
  std::vector<std::string> environment{};  // NAME=value each, in addition to ours
};

// Returns the folder of the running executable.
std::filesystem::path program_folder();
// Returns the folder of the installed files: radar/*.cfg, lab.toml. A build folder has links to
// them.
std::filesystem::path data_folder();
// Returns FOLDER/NAME if it exists, otherwise the installed file of this name. A .cfg is also found
// by its file name alone.
std::filesystem::path here_or_installed(const std::filesystem::path& name,
                                        const std::filesystem::path& folder = {});
// Returns the effective user's name; under sudo, the caller's.
std::string login_name();
// Returns the number of cores available to this program (taskset, cpusets); at least 1.
unsigned usable_cores();
// Returns how this user can get access to a device node: by the node's group, or by our udev rules.
std::string permission_hint(const std::string& node);
// Returns the host name.
std::string machine_name();
// Returns the path of our program in the folder of this one, otherwise NAME for a search in PATH.
std::string program_beside(const std::string& name);

// Returns why start_program() cannot start a program of this name; empty if it can.
std::string fault_of_program(const std::string& name);

// Starts words[0], found in PATH, with the other words as arguments. Passes only the three standard
// files, because an inherited descriptor would keep an unplugged port open.
Result<pid_t> start_program(const std::vector<std::string>& words,
                            const ProgramOptions& options = {});

// Waits for the program. Returns its exit code, or 128 plus the signal number.
int wait_for_program(pid_t program);

}  // namespace echofuse
