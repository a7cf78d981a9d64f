// SPDX-License-Identifier: MIT
// Command-line parsing for all programs, with uniform error messages.
#pragma once
#include <CLI/CLI.hpp>
#include <initializer_list>
#include <string>

namespace echofuse {

inline constexpr double max_seed = 1e18;  // limit of --seed

// Parses like app.parse(). If a command or option is unknown, the message of CLI::ParseError
// suggests the most similar name. Error messages describe ranges in plain words. `help` as the
// first word means --help. Commands accept their parents' options, and list them in their --help.
void parse_command_line(CLI::App& app, int argc, const char* const* argv);

// Moves these options to the group "More options" at the end of --help.
void more_options(CLI::App& command, std::initializer_list<const char*> names);

// Adds examples and exit codes to the end of the --help text and to the manual page. `codes`: exit
// codes other than 0, 1 and 2, for example "3 config, 6 disk".
void add_examples(CLI::App& command, std::initializer_list<const char*> lines,
                  const std::string& codes = {});

}  // namespace echofuse
