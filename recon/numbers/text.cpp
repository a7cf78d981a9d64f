// SPDX-License-Identifier: MIT
#include "recon/numbers/text.hpp"

#include <cstdarg>
#include <cstdio>

namespace echofuse::recon {

std::string formatted(const char* format, ...) {
  char text[240];
  va_list values;
  va_start(values, format);
  std::vsnprintf(text, sizeof text, format, values);
  va_end(values);
  return text;
}

}  // namespace echofuse::recon
