// SPDX-License-Identifier: MIT
#include <algorithm>

#include "drivers/chart/chart.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/program/atomic_write.hpp"

namespace echofuse::chart {

std::string stand_alone(const std::string& title, const std::vector<Drawing>& drawings,
                        std::size_t columns) {
  constexpr double edge = 10, between = 16;
  const double head = title.empty() ? edge : 38;
  std::string body;
  double x = edge, y = head, width = 2 * edge + text_width(title, 16), row_height = 0;
  for (std::size_t i = 0; i < drawings.size(); ++i) {
    if (i % columns == 0 && i > 0) x = edge, y += row_height + between, row_height = 0;
    const Drawing& d = drawings[i];
    body += "<g transform=\"translate(" + number(x) + " " + number(y) + ")\">" + d.svg + "</g>\n";
    x += d.width + between;
    width = std::max(width, x - between + edge);
    row_height = std::max(row_height, d.height);
  }
  const std::string w = number(width), h = number(y + row_height + edge);
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" "
         "class=\"drawing\" width=\"" +
         w + "\" height=\"" + h + "\" viewBox=\"0 0 " + w + " " + h + "\"><style>\n" +
         drawing_style(false) + "</style><rect class=\"paper\" width=\"" + w + "\" height=\"" + h +
         "\"/>\n" +
         (title.empty()
              ? ""
              : "<text class=\"title big\" x=\"14\" y=\"25\">" + escaped(title) + "</text>\n") +
         body + "</svg>\n";
}

std::string stand_alone(const std::string& title, const std::vector<Panel>& panels,
                        std::size_t columns) {
  std::vector<Drawing> drawings;
  for (const Panel& p : panels) drawings.push_back(draw(p));
  return stand_alone(title, drawings, columns);
}

std::string for_both_widths(const Panel& panel) {
  if (panel.width <= 1.1 * narrow_px) return draw(panel).svg;
  Panel narrow = panel;
  narrow.width = narrow_px;
  constexpr std::string_view plain = "class=\"drawing\"";
  std::string a = draw(panel).svg, b = draw(narrow).svg;
  a.replace(a.find(plain), plain.size(), "class=\"drawing wide-only\"");
  b.replace(b.find(plain), plain.size(), "class=\"drawing narrow-only\"");
  return a + b;
}

void write_chart(const std::string& folder, const std::string& name, const std::string& csv,
                 const std::string& svg) {
  write_atomically(folder + "/" + name + ".csv", csv);
  write_atomically(folder + "/" + name + ".svg", svg);
}

}  // namespace echofuse::chart
