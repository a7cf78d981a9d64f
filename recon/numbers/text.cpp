// SPDX-License-Identifier: MIT
#include "recon/numbers/text.hpp"

#include <sstream>

namespace echofuse::recon {

std::vector<std::string> split_at_commas(const std::string& text) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, ',');) out.push_back(part);
  return out;
}

}  // namespace echofuse::recon
