// SPDX-License-Identifier: MIT
// Other programs, started by this one.
#pragma once
#include <sys/types.h>

#include <filesystem>
#include <string>
#include <vector>

#include "drivers/core/result.hpp"

namespace echofuse {

struct ProgramOptions {
  std::string folder{};  // its working directory; empty: this program's
  int output = 1;        // the file descriptor that is its standard output
};

// The folder of the running program's file.
std::filesystem::path program_folder();
// Folder of the installed files: radar/*.cfg, lab.toml. A build folder has links to them.
std::filesystem::path data_folder();
// FOLDER/NAME, or what is installed with the programs by this name if nothing is there: a .cfg by
// its name alone, too.
std::filesystem::path here_or_installed(const std::filesystem::path& name,
                                        const std::filesystem::path& folder = {});
// Name of the effective user; under sudo, of the user who called it.
std::string login_name();
// The cores that this program may use (taskset, cgroups' cpusets); at least 1.
unsigned usable_cores();
// How this user gets access to a device node: by the node's group, or else by our udev rules.
std::string permission_hint(const std::string& node);
// Host name.
std::string machine_name();
// First word by which to start our program: its path beside this one, else NAME, as PATH has it.
std::string program_beside(const std::string& name);

// Starts words[0], found by PATH, with the other words as its arguments. Passes on the three
// standard files and no other: an inherited descriptor would keep an unplugged port open.
Result<pid_t> start_program(const std::vector<std::string>& words,
                            const ProgramOptions& options = {});

// Waits for its end: its exit code, or 128 and the number of the signal that ended it.
int wait_for_program(pid_t program);

}  // namespace echofuse
