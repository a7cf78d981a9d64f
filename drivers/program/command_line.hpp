// SPDX-License-Identifier: MIT
// One way to read a command line: all programs answer a slip of the finger alike.
#pragma once
#include <CLI/CLI.hpp>

namespace echofuse {

// As app.parse(), whose CLI::ParseError names the nearest command or option for one that it does
// not know, and says a range as a person reads it. `help` as the first word is --help.
void parse_command_line(CLI::App& app, int argc, const char* const* argv);

}  // namespace echofuse
