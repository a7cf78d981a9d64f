// SPDX-License-Identifier: MIT
#include "recon/files/text.hpp"

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

std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> out;
  std::istringstream in(line);
  for (std::string cell; std::getline(in, cell, ',');) out.push_back(cell);
  return out;
}

}  // namespace echofuse::recon
