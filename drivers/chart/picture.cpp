// SPDX-License-Identifier: MIT
#include "drivers/chart/picture.hpp"

#include <algorithm>
#include <cstdio>
#include <tuple>

#include "drivers/chart/style.hpp"

namespace echofuse::chart {
namespace {

constexpr double left_room = 52, bar_room = 74, top_room = 28, bottom_room = 40, line_px = 17;

std::string rect(const std::string& style, double x, double y, double w, double h) {
  return "<rect " + style + " x=\"" + number(x) + "\" y=\"" + number(y) + "\" width=\"" +
         number(w) + "\" height=\"" + number(h) + "\"/>";
}

std::string text(const std::string& attributes, double x, double y, const std::string& words) {
  return "<text " + attributes + " x=\"" + number(x) + "\" y=\"" + number(y) + "\">" +
         escaped(words) + "</text>";
}

std::string hex(const Rgb& c) {
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", c[0], c[1], c[2]);
  return text;
}

std::string fill(const Rgb& c) { return "fill=\"" + hex(c) + "\""; }

std::string open_svg(double width, double height, const std::string& spoken) {
  const std::string w = number(width), h = number(height);
  return "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"drawing\" role=\"img\" width=\"" + w +
         "\" height=\"" + h + "\" viewBox=\"0 0 " + w + " " + h + "\"><title>" + escaped(spoken) +
         "</title>";
}

// Value and name of each tick.
std::vector<std::pair<double, std::string>> edge_ticks(double first, double last, bool degrees,
                                                       double length) {
  std::vector<std::pair<double, std::string>> out;
  const double low = std::min(first, last), high = std::max(first, last);
  if (!degrees) {
    for (const double v : round_ticks(low, high, false, length))
      out.emplace_back(v, short_number(v));
    return out;
  }
  const double to_degrees = 180 / M_PI;
  for (const double d :
       round_ticks(std::atan(low) * to_degrees, std::atan(high) * to_degrees, false, length))
    out.emplace_back(std::tan(d / to_degrees), short_number(d) + "°");
  return out;
}

// An arrow at either end beyond which there is something.
std::string draw_bar(const Picture& p, double x, double height) {
  constexpr int steps = 64;
  const Bar& bar = p.bar;
  std::string out;
  for (int k = 0; k < steps; ++k)
    out += rect(fill(colour_of(bar.map, 1 - (k + 0.5) / steps)), x, top_room + height * k / steps,
                12, height / steps + 0.6);
  for (const auto& [share, end, way] : {std::tuple{p.above, 1.0, -1}, {p.below, 0.0, 1}}) {
    if (!(share > 0)) continue;
    const double y = top_room + height * (1 - end);
    out += "<polygon class=\"edge\" style=\"fill:" + hex(colour_of(bar.map, end)) + "\" points=\"" +
           number(x) + "," + number(y) + " " + number(x + 12) + "," + number(y) + " " +
           number(x + 6) + "," + number(y + way * 9) + "\"/>";
  }
  for (const double v : round_ticks(bar.first, bar.last, false, height * 1.2)) {
    const double y = top_room + height * (1 - (v - bar.first) / (bar.last - bar.first));
    out += text("", x + 17, std::clamp(y + 4.5, top_room + 10, top_room + height),
                short_number(v) + " " + bar.unit);
  }
  return out;
}

struct Cells {
  double left, top, width, height;  // of one
  std::string move(double column, double row) const {
    return "M" + number(left + column * width) + " " + number(top + row * height);
  }
};

std::string path(const char* classes, const std::string& d) {
  return d.empty() ? "" : std::string("<path class=\"") + classes + "\" d=\"" + d + "\"/>";
}

// Where a cell that is meant has a neighbour that is not.
std::string outline(const std::vector<bool>& cells, std::size_t columns, const Cells& at) {
  std::string d;
  for (std::size_t i = columns; i < cells.size(); ++i) {
    const auto column = static_cast<double>(i % columns), row = static_cast<double>(i / columns);
    if (cells[i] != cells[i - columns]) d += at.move(column, row) + "h" + number(at.width);
    if (i % columns > 0 && cells[i] != cells[i - 1])
      d += at.move(column, row) + "v" + number(at.height);
  }
  return path("outline", d);
}

std::string draw(const Marks& m, double left, double top, double width, double height) {
  const std::size_t all = m.outlined.size();
  if (m.columns == 0 || all == 0) return {};
  const auto columns = static_cast<double>(m.columns);
  const Cells at{left, top, width / columns, height / (static_cast<double>(all) / columns)};
  return outline(m.outlined, m.columns, at);
}

}  // namespace

Drawing draw(const Picture& p) {
  const double inner = p.width - left_room - bar_room;
  const double ratio = p.ratio > 0 ? p.ratio : std::abs((p.top - p.bottom) / (p.right - p.left));
  const double high = inner * ratio, bottom = top_room + high;
  const auto notes =
      p.note.empty() ? std::vector<std::string>{} : wrapped(p.note, p.width - left_room);
  const double height = bottom + bottom_room + line_px * static_cast<double>(notes.size());
  std::string out = open_svg(p.width, height, p.title);
  out += text("class=\"title\"", 4, 16, p.title);
  out += "<image preserveAspectRatio=\"none\" x=\"" + number(left_room) + "\" y=\"" +
         number(top_room) + "\" width=\"" + number(inner) + "\" height=\"" + number(high) +
         "\" href=\"" + data_uri("image/png", p.png) + "\"/>";
  out += draw(p.marks, left_room, top_room, inner, high);
  out += rect("class=\"edge\"", left_room, top_room, inner, high);
  for (const auto& [at, name] :
       edge_ticks(p.left, p.right, p.degrees, p.degrees ? 1.5 * inner : inner)) {
    const double x = left_room + (at - p.left) / (p.right - p.left) * inner;
    out += rect("class=\"quiet\"", x - 0.5, bottom, 1, 4) +
           text("text-anchor=\"middle\"", x, bottom + 17, name);
  }
  for (const auto& [at, name] :
       edge_ticks(p.bottom, p.top, p.degrees, p.degrees ? 1.5 * high : high)) {
    const double y = top_room + (p.top - at) / (p.top - p.bottom) * high;
    out += rect("class=\"quiet\"", left_room - 4, y - 0.5, 4, 1) +
           text("text-anchor=\"end\"", left_room - 7, y + 4.5, name);
  }
  out +=
      text("class=\"quiet\" text-anchor=\"middle\"", left_room + inner / 2, bottom + 34, p.x_title);
  out += "<text class=\"quiet\" text-anchor=\"middle\" transform=\"translate(13 " +
         number(top_room + high / 2) + ") rotate(-90)\">" + escaped(p.y_title) + "</text>";
  out += draw_bar(p, left_room + inner + 12, high);
  double y = bottom + bottom_room;
  for (const std::string& note : notes)
    out += text("class=\"quiet\"", left_room, y + 12, note), y += line_px;
  return {out + "</svg>", p.width, height};
}

Drawing no_picture(const std::string& title, const std::string& why, double width) {
  const double inner = width - left_room - bar_room, height = top_room + inner + bottom_room;
  return {open_svg(width, height, title) + text("class=\"title\"", 4, 16, title) +
              rect("class=\"void\"", left_room, top_room, inner, inner) +
              text("text-anchor=\"middle\"", left_room + inner / 2, top_room + inner / 2, why) +
              "</svg>",
          width, height};
}

Bar depth_bar(double near_m, double far_m) { return {ColourMap::near, near_m, far_m, "m"}; }

}  // namespace echofuse::chart
