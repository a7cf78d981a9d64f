// SPDX-License-Identifier: MIT
#pragma once
#include <cstddef>
#include <string>
#include <string_view>

namespace echofuse {

// Quotes a string as a CSV cell (RFC 4180). If the string begins with =, +, -, @ or a similar
// character, prepends an apostrophe, because a spreadsheet would otherwise evaluate it as a
// formula.
inline std::string csv_text(std::string_view text) {
  constexpr std::string_view begins_formula = "=+-@\t\r\n|%";
  std::string out = "\"";
  if (!text.empty() && begins_formula.find(text[0]) != text.npos) out += '\'';
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + '"';
}

// Makes external text (from a file, device or command line) safe for a terminal, log or message.
// Returns one line of valid UTF-8. Escapes control characters (as \n or \x1b), characters that
// change the text direction (as \u202e), and bytes that are not UTF-8 (as \xff). Truncates strings
// longer than `longest` bytes at a character boundary and appends "...".
std::string printable(std::string_view text, std::size_t longest = std::string_view::npos);

// Like printable(), but keeps line breaks; used for multi-line messages.
std::string printable_lines(std::string_view text);

// Escapes only bytes that are not UTF-8 (\xff). Used for names in JSON.
std::string utf8_text(std::string_view text);

}  // namespace echofuse
