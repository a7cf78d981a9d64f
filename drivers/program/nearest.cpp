// SPDX-License-Identifier: MIT
#include <algorithm>

#include "drivers/program/settings.hpp"

namespace echofuse {
namespace {

// Letters that are added, left out, exchanged or swapped with their neighbour.
std::size_t edit_distance(const std::string& a, const std::string& b) {
  std::vector<std::vector<std::size_t>> at(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i)
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        at[i][j] = i + j;
        continue;
      }
      at[i][j] = std::min({at[i - 1][j] + 1, at[i][j - 1] + 1,
                           at[i - 1][j - 1] + (a[i - 1] != b[j - 1] ? 1u : 0u)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        at[i][j] = std::min(at[i][j], at[i - 2][j - 2] + 1);
    }
  return at[a.size()][b.size()];
}

}  // namespace

std::string nearest(const std::vector<std::string>& known, const std::string& key) {
  const auto changes = [&](const std::string& name) {
    const bool part = key.find(name) != key.npos || name.find(key) != name.npos;
    return edit_distance(name, key) * (part ? 1 : 2);
  };
  const auto it = std::min_element(known.begin(), known.end(),
                                   [&](auto& a, auto& b) { return changes(a) < changes(b); });
  return it == known.end() || changes(*it) > key.size() ? "" : *it;
}

}  // namespace echofuse
