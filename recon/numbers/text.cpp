// SPDX-License-Identifier: MIT
#include "recon/numbers/text.hpp"

#include <cstdarg>
#include <cstdio>
#include <sstream>

namespace echofuse::recon {

std::string formatted(const char* format, ...) {
  char text[240];
  va_list values;
  va_start(values, format);
  std::vsnprintf(text, sizeof text, format, values);
  va_end(values);
  return text;
}

std::vector<std::string> split_at_commas(const std::string& text) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, ',');) out.push_back(part);
  return out;
}

}  // namespace echofuse::recon
