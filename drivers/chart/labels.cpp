// SPDX-License-Identifier: MIT
#include "drivers/chart/labels.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace echofuse::chart {

std::vector<double> spread_apart(std::vector<double> wanted, double gap, double top,
                                 double bottom) {
  std::vector<std::size_t> order(wanted.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return wanted[a] < wanted[b]; });
  // Neighbours that meet become one group about the mean of what they want.
  struct Group {
    double sum;  // of what each wants, less its place within the group
    std::size_t count;
    double first(double gap, double top, double bottom) const {
      const double at = sum / static_cast<double>(count);
      return std::max(top, std::min(at, bottom - gap * static_cast<double>(count - 1)));
    }
  };
  std::vector<Group> groups;
  for (const std::size_t i : order) {
    groups.push_back({wanted[i], 1});
    while (groups.size() > 1) {
      const Group last = groups.back();
      Group& before = groups[groups.size() - 2];
      const auto n = static_cast<double>(before.count);
      if (before.first(gap, top, bottom) + gap * n <= last.first(gap, top, bottom)) break;
      before.sum += last.sum - gap * n * static_cast<double>(last.count);
      before.count += last.count;
      groups.pop_back();
    }
  }
  std::size_t k = 0;
  for (const Group& g : groups) {
    const double first = g.first(gap, top, bottom);
    for (std::size_t i = 0; i < g.count; ++i, ++k)
      wanted[order[k]] = first + gap * static_cast<double>(i);
  }
  return wanted;
}

Place place_label(double x, double y, double width, const Box& area, std::vector<Box>& taken) {
  constexpr double height = 14, ascent = 10.5;
  Place best;
  Box best_box{};
  double least = 1e9;
  for (const double away : {8.0, 20.0, 34.0, 50.0, 68.0})
    for (int k = 0; k < 12; ++k) {
      // To the right first, then round, alternately up and down.
      const double angle = (k % 2 ? 1 : -1) * std::ceil(k / 2.0) * M_PI / 6;
      const double dx = away * std::cos(angle), dy = -away * std::sin(angle);
      const double left = x + dx - width * (1 - std::cos(angle)) / 2;
      const double middle = y + dy;
      const Box box{left, middle - height / 2, left + width, middle + height / 2};
      double cost = away + 3 * k;
      for (const Box& other : taken) cost += box.meets(other) ? 200 : 0;
      if (box.left < area.left || box.right > area.right || box.top < area.top ||
          box.bottom > area.bottom)
        cost += 1000;
      if (cost >= least) continue;
      least = cost, best_box = box;
      best = {left, middle - height / 2 + ascent, away > 12};
    }
  taken.push_back(best_box);
  return best;
}

}  // namespace echofuse::chart
