// SPDX-License-Identifier: MIT
// Where the texts of a chart go, so that none lies over another.
#pragma once
#include <vector>

namespace echofuse::chart {

struct Box {
  double left, top, right, bottom;
  bool meets(const Box& other) const {
    return left < other.right && other.left < right && top < other.bottom && other.top < bottom;
  }
};

// Heights that texts want, moved apart to `gap` within [top, bottom], each as little as can be; in
// the given order.
std::vector<double> spread_apart(std::vector<double> wanted, double gap, double top, double bottom);

struct Place {
  double x = 0, y = 0;  // of the text's left end and baseline
  bool far = false;     // so far from its point that a line should lead there
};

// A text of this width beside a point, within `area`, off what is taken; what it takes is added.
Place place_label(double x, double y, double width, const Box& area, std::vector<Box>& taken);

}  // namespace echofuse::chart
