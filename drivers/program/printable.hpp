// SPDX-License-Identifier: MIT
#pragma once
#include <cstddef>
#include <string>
#include <string_view>

namespace echofuse {

// A text that came from outside (a file, a device, a command line), for a terminal, a log or a
// message: valid UTF-8 in one line, whatever it holds. Characters that a terminal obeys or that
// reorder the line are written out (\n, \x1b, \u202e), and so are bytes that are not UTF-8 (\xff).
// What is longer than `longest` bytes is cut at a character and ends in "...".
std::string printable(std::string_view text, std::size_t longest = std::string_view::npos);

// The same, but lines stay lines: for messages of several lines, as the faults of a configuration.
std::string printable_lines(std::string_view text);

// A name for JSON: only what is not UTF-8 is written out (\xff).
std::string utf8_text(std::string_view text);

}  // namespace echofuse
