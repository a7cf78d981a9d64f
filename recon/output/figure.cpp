// SPDX-License-Identifier: MIT
#include "recon/output/figure.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "acquire/record/png.hpp"
#include "drivers/core/exit_code.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

const cv::Scalar ink(50, 50, 50), faint(215, 215, 215), paper(255, 255, 255);
const cv::Scalar curve_colours[] = {{180, 119, 31}, {14, 127, 255}};  // BGR, as enum Ink
const cv::Scalar red(30, 38, 179);
constexpr int margin_x = 110, margin_y = 84, gap = 78, panel = 300, plot_width = 380,
              row_height = 386;
constexpr double most_deviation_m = 2;  // half of what a body stands out by: as unsure as it gets

Bytes png_of(const cv::Mat& image) {
  cv::Mat rgb;
  cv::cvtColor(image, rgb, cv::COLOR_BGR2RGB);
  Bytes out = record::encode_png_rgb({rgb.data, rgb.total() * rgb.elemSize()},
                                     static_cast<std::uint32_t>(rgb.cols),
                                     static_cast<std::uint32_t>(rgb.rows));
  if (out.empty()) throw Error(ExitCode::failed, "cannot encode a PNG picture");
  return out;
}

cv::Mat coloured(std::span<const float> map, double farthest_m, int zoom) {
  const int size = static_cast<int>(std::lround(std::sqrt(static_cast<double>(map.size()))));
  cv::Mat grey(size, size, CV_8U), small, large;
  for (int i = 0; i < size * size; ++i)
    grey.data[i] = cv::saturate_cast<std::uint8_t>(
        std::lround(255 * double{map[static_cast<std::size_t>(i)]} / farthest_m));
  cv::applyColorMap(grey, small, cv::COLORMAP_VIRIDIS);
  cv::resize(small, large, {}, zoom, zoom, cv::INTER_NEAREST);
  return large;
}

enum class Align { left, centre, right };
void write(cv::Mat& canvas, const std::string& text, cv::Point at, Align align = Align::centre,
           double scale = 0.5, const cv::Scalar& colour = ink) {
  int base = 0;
  const int width = cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale, 1, &base).width;
  if (align == Align::centre) at.x -= width / 2;
  if (align == Align::right) at.x -= width;
  cv::putText(canvas, text, at, cv::FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv::LINE_AA);
}

// A step for about `count` round ticks over a span.
double tick_step(double span, int count) {
  const double rough = span / count, power = std::pow(10, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0})
    if (factor * power >= rough) return factor * power;
  return 10 * power;
}

void draw_axes(cv::Mat& canvas, const cv::Rect& box, double first, double last) {
  const double step = tick_step(last - first, 6);
  const auto from = static_cast<int>(std::ceil(first / step - 1e-9));
  const auto to = static_cast<int>(std::floor(last / step + 1e-9));
  for (int tick = from; tick <= to; ++tick) {
    const double t = tick * step;
    const int x = box.x + static_cast<int>(std::lround((t - first) / (last - first) * box.width));
    cv::line(canvas, {x, box.y}, {x, box.br().y}, faint, 1);
    write(canvas, formatted("%g", t), {x, box.br().y + 18}, Align::centre, 0.42);
  }
  cv::rectangle(canvas, box, ink, 1);
  write(canvas, "range (m)", {box.x + box.width / 2, box.br().y + 38}, Align::centre, 0.45);
}

void draw_curves(cv::Mat& canvas, const cv::Rect& box, const std::vector<Curve>& curves) {
  double first = 1e300, last = -1e300;
  for (const auto& c : curves) {
    first = std::min(first, c.range_m.front());
    last = std::max(last, c.range_m.back());
  }
  if (!(last > first)) return;
  draw_axes(canvas, box, first, last);
  for (std::size_t k = 0; k < curves.size(); ++k) {
    const Curve& c = curves[k];
    const double peak = std::max(*std::max_element(c.value.begin(), c.value.end()), 1e-300);
    std::vector<cv::Point> line;
    for (std::size_t i = 0; i < c.value.size(); ++i) {
      const double x = (c.range_m[i] - first) / (last - first);
      const double y = std::clamp(c.value[i] / peak, -0.04, 1.0) / 1.12;
      line.emplace_back(box.x + static_cast<int>(std::lround(x * box.width)),
                        box.br().y - static_cast<int>(std::lround((y + 0.04) * box.height)));
    }
    const cv::Scalar& colour = curve_colours[static_cast<std::size_t>(c.ink)];
    cv::polylines(canvas, line, false, colour, 2, cv::LINE_AA);
    const int y = box.y + 22 + 20 * static_cast<int>(k);
    write(canvas, c.name, {box.br().x - 10, y}, Align::right, 0.45, colour);
  }
}

void draw_map(cv::Mat& canvas, cv::Point at, std::span<const float> map, double farthest_m,
              double half_tangent) {
  cv::Mat picture;
  cv::resize(coloured(map, farthest_m, 1), picture, {panel, panel}, 0, 0, cv::INTER_NEAREST);
  picture.copyTo(canvas({at.x, at.y, panel, panel}));
  const cv::Rect box(at.x, at.y, panel, panel);
  cv::rectangle(canvas, box, ink, 1);
  const double label_at = half_tangent > 0.5 ? 0.5 : tick_step(half_tangent / 2, 1);
  for (const double tangent : {-label_at, 0.0, label_at}) {
    const double share = 0.5 + tangent / (2 * half_tangent);
    const int offset = static_cast<int>(std::lround(share * panel));
    const std::string label = formatted("%g", tangent);
    write(canvas, label, {at.x + offset, box.br().y + 18}, Align::centre, 0.42);
    write(canvas, label, {at.x - 6, box.br().y - offset + 5}, Align::right, 0.42);
  }
  write(canvas, "x / z", {at.x + panel / 2, box.br().y + 38}, Align::centre, 0.45);
}

void draw_bar(cv::Mat& canvas, cv::Point at, double farthest_m, const char* title) {
  cv::Mat ramp(panel, 1, CV_8U), bar;
  for (int i = 0; i < panel; ++i)
    ramp.at<std::uint8_t>(i) = static_cast<std::uint8_t>(255 - 255 * i / (panel - 1));
  cv::applyColorMap(ramp, bar, cv::COLORMAP_VIRIDIS);
  cv::resize(bar, bar, {18, panel}, 0, 0, cv::INTER_NEAREST);
  bar.copyTo(canvas({at.x, at.y, 18, panel}));
  cv::rectangle(canvas, cv::Rect(at.x, at.y, 18, panel), ink, 1);
  for (int d = 0; d <= static_cast<int>(farthest_m); ++d) {
    const int y = at.y + panel - static_cast<int>(std::lround(d / farthest_m * panel));
    write(canvas, std::to_string(d), {at.x + 26, y + 5}, Align::left, 0.42);
  }
  write(canvas, title, {at.x + 12, at.y - 10}, Align::centre, 0.42);
}

double farthest_of(const std::vector<FigureRow>& rows) {
  double out = 1;
  for (const auto& row : rows)
    for (const float v : row.truth) out = std::max(out, double{v});
  return std::ceil(out);
}

}  // namespace

Bytes depth_picture(std::span<const float> map, double farthest_m, int zoom) {
  return png_of(coloured(map, farthest_m, zoom));
}

Bytes figure(const std::string& title, const std::vector<FigureRow>& rows, double half_tangent) {
  const int truth_x = margin_x + plot_width + gap, map_x = truth_x + panel + gap;
  const int deviation_x = map_x + panel + 130;
  const int height = margin_y + row_height * static_cast<int>(rows.size());
  const bool deviations = std::any_of(rows.begin(), rows.end(),
                                      [](const FigureRow& r) { return !r.deviation.empty(); });
  const int width = (deviations ? deviation_x : map_x) + panel + 100;
  cv::Mat canvas(height, width, CV_8UC3, paper);
  const double farthest_m = farthest_of(rows);
  write(canvas, title, {margin_x, 32}, Align::left, 0.7);
  write(canvas, "measured", {margin_x + plot_width / 2, margin_y - 18}, Align::centre, 0.55);
  write(canvas, "truth (depth camera)", {truth_x + panel / 2, margin_y - 18}, Align::centre, 0.55);
  write(canvas, "reconstruction", {map_x + panel / 2, margin_y - 18}, Align::centre, 0.55);
  if (deviations)
    write(canvas, "its uncertainty (standard deviation)", {deviation_x + panel / 2, margin_y - 18},
          Align::centre, 0.55);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const int y = margin_y + row_height * static_cast<int>(i);
    write(canvas, rows[i].name, {margin_x / 2, y + panel / 2}, Align::centre, 0.6);
    draw_curves(canvas, {margin_x, y, plot_width, panel}, rows[i].curves);
    draw_map(canvas, {truth_x, y}, rows[i].truth, farthest_m, half_tangent);
    draw_map(canvas, {map_x, y}, rows[i].reconstruction, farthest_m, half_tangent);
    write(canvas, rows[i].caption, {map_x + panel / 2, y + panel + 58}, Align::centre, 0.45);
    draw_bar(canvas, {map_x + panel + 28, y}, farthest_m, "depth (m)");
    if (rows[i].deviation.empty()) {
      write(canvas, rows[i].uncertainty, {map_x + panel / 2, y + panel + 76}, Align::centre, 0.45);
      continue;
    }
    draw_map(canvas, {deviation_x, y}, rows[i].deviation, most_deviation_m, half_tangent);
    write(canvas, rows[i].uncertainty, {deviation_x + panel / 2, y + panel + 58}, Align::centre,
          0.45);
    write(canvas, rows[i].warning, {deviation_x + panel, y + panel + 76}, Align::right, 0.45, red);
    draw_bar(canvas, {deviation_x + panel + 28, y}, most_deviation_m, "+- (m)");
  }
  return png_of(canvas);
}

}  // namespace echofuse::recon
