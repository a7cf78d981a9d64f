// SPDX-License-Identifier: MIT
// Command line of all programs, with the same answers to a slip of the finger.
#pragma once
#include <CLI/CLI.hpp>
#include <initializer_list>

namespace echofuse {

// Parses as app.parse(), but CLI::ParseError names the nearest command or option for an unknown
// one, and a range in plain words. `help` as the first word is --help. Commands take the options
// of those above them, and their --help names these.
void parse_command_line(CLI::App& app, int argc, const char* const* argv);

// Lists these options of the command in --help below the others, as "More options".
void more_options(CLI::App& command, std::initializer_list<const char*> names);

// Lines as somebody would type them, for the end of --help and the manual page.
void add_examples(CLI::App& command, std::initializer_list<const char*> lines);

}  // namespace echofuse
