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
  std::string folder{};  // working directory; if empty, it is inherited from this program
  int output = 1;        // file descriptor used as the program's standard output
  // If true, the program has its own process group, reads from /dev/null and writes to this
  // program's stderr.
  bool background = false;
  std::vector<std::string> environment{};  // NAME=value pairs, which replace inherited ones
};

std::filesystem::path program_folder();
// Returns the folder that contains the installed files lab.toml and radar/*.cfg. A build folder
// contains links to these files.
std::filesystem::path data_folder();
// Returns FOLDER/NAME if it exists, otherwise the path of the installed file with this name. The
// name of an installed .cfg may omit the folder `radar`.
std::filesystem::path here_or_installed(const std::filesystem::path& name,
                                        const std::filesystem::path& folder = {});
// Returns the name of the effective user; under sudo, the name of the user who called sudo.
std::string login_name();
// Returns the number of cores available to this program (taskset, cpusets); at least 1.
unsigned usable_cores();
// Returns the widest SIMD instruction set of the processor that echofuse uses, for example "AVX2".
std::string instruction_set();
// Returns how the user can get access to a device node: by joining the node's group, or by
// installing echofuse's udev rules.
std::string permission_hint(const std::string& node);
std::string machine_name();
// Returns the path of a program in the folder of the running program. If it does not exist there,
// returns NAME, so that start_program() searches PATH for it.
std::string sibling_program(const std::string& name);

// Returns the reason why start_program() cannot start a program with this name, or an empty string
// if it can.
std::string fault_of_program(const std::string& name);

// Searches PATH for the program words[0] and starts it with the other words as arguments. The new
// program inherits only stdin, stdout and stderr, because any other inherited descriptor could keep
// an unplugged port open.
Result<pid_t> start_program(const std::vector<std::string>& words,
                            const ProgramOptions& options = {});

// Waits until the program ends. Returns its exit code, or 128 plus the number of the signal that
// ended it.
int wait_for_program(pid_t program);

}  // namespace echofuse
