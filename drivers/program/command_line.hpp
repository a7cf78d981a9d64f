// SPDX-License-Identifier: MIT
// Command line parsing of all programs, with the same error messages.
#pragma once
#include <CLI/CLI.hpp>
#include <initializer_list>

namespace echofuse {

// Parses like app.parse(). CLI::ParseError suggests the nearest name for an unknown command or
// option, and states ranges in plain words. `help` as the first word means --help. Commands accept
// the options of their parents, and their --help lists these.
void parse_command_line(CLI::App& app, int argc, const char* const* argv);

// Moves these options to the group "More options" at the end of --help.
void more_options(CLI::App& command, std::initializer_list<const char*> names);

// Adds example command lines to the end of --help and to the manual page.
void add_examples(CLI::App& command, std::initializer_list<const char*> lines);

}  // namespace echofuse
