// SPDX-License-Identifier: MIT
// A picture with scales: a raster over two spans, degrees or other units at its edges, and its bar.
#pragma once
#include <string>
#include <utility>
#include <vector>

#include "drivers/chart/chart.hpp"
#include "drivers/chart/colour_map.hpp"

namespace echofuse::chart {

struct Bar {
  ColourMap map = ColourMap::near;
  double first = 0, last = 1;
  std::string unit;
};

// Cells of a raster by their number, row after row: what has no place on the bar.
struct Marks {
  std::size_t columns = 0;
  std::vector<bool> outlined = {};  // as many as the raster has, or none
};

struct Picture {
  std::string title;
  Bytes png;  // of the raster
  // Of the raster's edges. Degrees: these are tangents.
  double left = -1, right = 1, bottom = -1, top = 1;
  bool degrees = true;
  std::string x_title = "azimuth", y_title = "elevation";
  Bar bar = {};
  Marks marks = {};
  double below = 0, above = 0;  // shares of what is shown that lie beyond the bar's ends: arrows
  std::string note = {};        // broken into lines
  double width = 340;
  double ratio = 0;  // height over width of the picture; 0: as the spans are
};

Drawing draw(const Picture& picture);
// In place of one, as wide and high as it: a grey field that says why.
Drawing no_picture(const std::string& title, const std::string& why, double width = 340);

Bar depth_bar(double near_m, double far_m);  // of a depth_raster

}  // namespace echofuse::chart
