// SPDX-License-Identifier: MIT
// One way to read a command line: all programs answer a slip of the finger alike.
#pragma once
#include <CLI/CLI.hpp>
#include <initializer_list>

namespace echofuse {

// As app.parse(), whose CLI::ParseError names the nearest command or option for one that it does
// not know, and says a range as a person reads it. `help` as the first word is --help.
void parse_command_line(CLI::App& app, int argc, const char* const* argv);

// In --help these options of the command stand below the others, as "More options".
void more_options(CLI::App& command, std::initializer_list<const char*> names);

// Lines as somebody would type them, for the end of --help and the manual page.
void add_examples(CLI::App& command, std::initializer_list<const char*> lines);

}  // namespace echofuse
