// SPDX-License-Identifier: MIT
#pragma once
#include <charconv>
#include <cstdarg>
#include <cstdio>
#include <sstream>
#include <string>
#include <vector>

namespace echofuse {

// Formats values as std::printf() does. Cuts the text after 511 bytes.
[[gnu::format(printf, 1, 2)]] inline std::string format(const char* pattern, ...) {
  char text[512];
  std::va_list values;
  va_start(values, pattern);
  std::vsnprintf(text, sizeof text, pattern, values);
  va_end(values);
  return text;
}

// Returns the numbers in a text, or nothing if it contains anything else. "nan" is a number.
inline std::vector<double> numbers_in(const std::string& text) {
  std::istringstream words(text);
  std::vector<double> out;
  for (std::string word; words >> word;) {
    const char *begin = word.data() + (word.starts_with('+') && !word.starts_with("+-") ? 1 : 0),
               *end = word.data() + word.size();
    const auto [rest, error] = std::from_chars(begin, end, out.emplace_back());
    if (error != std::errc() || rest != end) return {};
  }
  return out;
}

}  // namespace echofuse
