// SPDX-License-Identifier: MIT
#pragma once
#include <cstddef>
#include <string>
#include <string_view>

namespace echofuse {

// A text as a cell of a table (RFC 4180: in quotes, as it may hold commas, quotes and lines). An
// apostrophe before =, +, -, @ and the like keeps a spreadsheet from taking it for a formula.
inline std::string csv_text(std::string_view text) {
  constexpr std::string_view begins_formula = "=+-@\t\r\n|%";
  std::string out = "\"";
  if (!text.empty() && begins_formula.find(text[0]) != text.npos) out += '\'';
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + '"';
}

// Makes a text from outside (a file, a device, a command line) fit for a terminal, a log or a
// message. Returns valid UTF-8 in one line. Characters that a terminal obeys or that reorder the
// line are written out (\n, \x1b, \u202e). So are bytes that are not UTF-8 (\xff). More than
// `longest` bytes are cut at a character and end in "...".
std::string printable(std::string_view text, std::size_t longest = std::string_view::npos);

// Text as by printable(), but lines stay lines: for messages such as the faults of a configuration.
std::string printable_lines(std::string_view text);

// A name for JSON: only what is not UTF-8 is written out (\xff).
std::string utf8_text(std::string_view text);

}  // namespace echofuse
