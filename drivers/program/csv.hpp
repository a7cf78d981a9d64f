// SPDX-License-Identifier: MIT
#pragma once
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

}  // namespace echofuse
