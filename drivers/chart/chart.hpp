// SPDX-License-Identifier: MIT
// Charts as SVG: curves and points over two scales, each series named where it is drawn.
#pragma once
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

namespace echofuse::chart {

inline constexpr double nan = std::numeric_limits<double>::quiet_NaN();

struct Scale {
  std::string title;               // with the unit
  bool log = false;                // values that are not above 0 are left out
  double first = nan, last = nan;  // NaN: as the data have it
  // Ticks where they are wanted, in place of round numbers; a name may be empty.
  std::vector<std::pair<double, std::string>> ticks = {};
};

struct Point {
  double x = 0, y = 0;           // NaN: not drawn, and a line is broken there
  double low = nan, high = nan;  // of y: ends of a bar
  std::string label = {};        // written beside it
  bool crossed = false;          // a cross over the marker; Panel::note should say what it means
};

enum class Look { line, markers, both, steps };

struct Series {
  std::string name;           // written at its last point, in its colour; may be empty
  std::vector<Point> points;  // of a line in order
  int colour = 0;             // style.hpp
  Look look = Look::both;
  bool dashed = false;
};

// A straight line across the chart.
struct Rule {
  double at = 0;
  std::string name;
  bool vertical = false;
};

struct Panel {
  std::string title;
  Scale x, y;
  std::vector<Series> series;
  std::vector<Rule> rules = {};
  std::string note = {};  // a line of text below
  double width = 460, height = 300;
};

// "250", "10 k", "1 M", "0.02"; "5 k" where 10 k and more stand beside it.
std::string short_number(double value, double beside = 0);
// Round ticks within the span, for a scale of this length.
std::vector<double> round_ticks(double first, double last, bool log, double length_px);

struct Drawing {
  std::string svg;  // an <svg> element, for a page with drawing_style
  double width = 0, height = 0;
};
Drawing draw(const Panel& panel);
// Two SVG elements, of which a page shows one: as wide as it is, and for a telephone and paper.
std::string for_both_widths(const Panel& panel);
inline constexpr double narrow_px = 350;
// A file that stands alone: drawings side by side, so many a row.
std::string stand_alone(const std::string& title, const std::vector<Drawing>& drawings,
                        std::size_t columns);
std::string stand_alone(const std::string& title, const std::vector<Panel>& panels,
                        std::size_t columns);

// Writes NAME.csv and NAME.svg into a folder that exists. Throws Error(disk); the table is written
// first.
void write_chart(const std::string& folder, const std::string& name, const std::string& csv,
                 const std::string& svg);

}  // namespace echofuse::chart
