// SPDX-License-Identifier: MIT
#include "recon/metrics/letters.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr double cell_m = 0.02, most_shift_m = 0.08;
constexpr double blur_depth_m = 3;  // depth at which templates are blurred by one pixel of the map
constexpr double middle_behind_nearest_m = 0.1;
constexpr float near_m = 0.15f, far_m = 0.35f;

using record::letter_sizes;
using Cells = cv::Mat1f;

int cells_of(double length_m) { return static_cast<int>(std::lround(length_m / cell_m)); }

// It draws the letter on its plate and one cell about it, four times as fine.
Cells template_of(std::size_t letter, std::size_t size, const record::MapGrid& grid) {
  constexpr int fine = 4;
  const cv::Size cells(cells_of(letter_sizes[size].width_m) + 2,
                       cells_of(letter_sizes[size].height_m) + 2);
  Cells drawn(fine * cells.height, fine * cells.width, 0.f), out;
  const auto point = [&](double u_m, double v_m) {
    return cv::Point(static_cast<int>(std::lround(fine * (u_m / cell_m + cells.width / 2.0))),
                     static_cast<int>(std::lround(fine * (cells.height / 2.0 - v_m / cell_m))));
  };
  for (const auto& s : record::letter_strokes(letters[letter], letter_sizes[size])) {
    const double length = std::hypot(s.u1 - s.u0, s.v1 - s.v0);
    const double u = (s.v1 - s.v0) / length * s.width_m / 2;
    const double v = (s.u1 - s.u0) / length * s.width_m / 2;
    const std::array<cv::Point, 4> corners{point(s.u0 + u, s.v0 - v), point(s.u1 + u, s.v1 - v),
                                           point(s.u1 - u, s.v1 + v), point(s.u0 - u, s.v0 + v)};
    cv::fillConvexPoly(drawn, corners.data(), 4, 1.f);
  }
  const int wide = 1 + 2 * static_cast<int>(fine * grid.step() * blur_depth_m / cell_m / 2);
  cv::blur(drawn, drawn, {wide, wide}, {-1, -1}, cv::BORDER_CONSTANT);
  cv::resize(drawn, out, cells, 0, 0, cv::INTER_AREA);
  return out;
}

// The layer is 1 at the plate's depth or before it, and 0 far behind it and where there is nothing.
Cells near_layer(std::span<const float> map, double depth_m, const Scene& scene) {
  const auto side = static_cast<int>(scene.grid.size);
  const auto shares = foreground_share(map, scene);
  Cells out(side, side, 0.f);
  for (std::size_t p = 0; p < shares.size(); ++p)
    if (shares[p] > 0.5f)
      out(static_cast<int>(p)) =
          std::clamp((static_cast<float>(depth_m) + far_m - map[p]) / (far_m - near_m), 0.f, 1.f);
  return out;
}

// It cuts the layer into cells about a place with these tangents.
Cells patch_of(const Cells& layer, const Scene& scene, const Plate& about, cv::Size cells) {
  const Axis across = scene.grid.x(), down = scene.grid.y();
  const double columns = cell_m / about.depth_m / across.step,
               rows = cell_m / about.depth_m / -down.step;
  const cv::Matx23d inverse(
      columns, 0, (about.x - across.start) / across.step - columns * (cells.width - 1) / 2.0, 0,
      rows, (about.y - down.start) / down.step - rows * (cells.height - 1) / 2.0);
  Cells out;
  cv::warpAffine(layer, out, inverse, cells, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
  return out;
}

// Returns the greatest normalised correlation, and how far it is from the patch's middle, in cells.
std::pair<double, cv::Point2d> best_match(const Cells& patch, const Cells& wanted) {
  Cells found;
  cv::matchTemplate(patch, wanted, found, cv::TM_CCOEFF_NORMED);
  double best = 0;
  cv::Point at;
  cv::minMaxLoc(found, nullptr, &best, nullptr, &at);
  return {best, {at.x - (found.cols - 1) / 2.0, at.y - (found.rows - 1) / 2.0}};
}

}  // namespace

std::optional<Plate> find_plate(std::span<const float> truth, const Scene& scene,
                                std::size_t letter) {
  double nearest = 1e9;
  for (std::size_t p = 0; p < truth.size(); ++p)
    if (true_foreground(truth[p], scene.background[p]))
      nearest = std::min(nearest, double{truth[p]});
  if (nearest == 1e9) return std::nullopt;
  Plate about{letter, 0, 0, 0, nearest + middle_behind_nearest_m};
  const Cells layer = near_layer(truth, about.depth_m, scene);
  const cv::Rect box = cv::boundingRect(layer > 0);
  about.x = scene.grid.x().at(box.x + (box.width - 1) / 2.0);
  about.y = scene.grid.y().at(box.y + (box.height - 1) / 2.0);
  const auto cells = [&](int pixels) {
    constexpr int margin = 24, most = 150;  // larger than a template
    return std::min(margin + cells_of(pixels * scene.grid.step() * about.depth_m), most);
  };
  const Cells patch = patch_of(layer, scene, about, {cells(box.width), cells(box.height)});
  Plate plate = about;
  double best = 0;
  for (std::size_t size = 0; size < letter_sizes.size(); ++size) {
    const auto [match, off] = best_match(patch, template_of(letter, size, scene.grid));
    if (match <= best) continue;
    best = match;
    plate = {letter, size, about.x + off.x * cell_m / about.depth_m,
             about.y - off.y * cell_m / about.depth_m, about.depth_m};
  }
  // The middle's depth is that of the near pixels within the plate.
  const auto& held = letter_sizes[plate.size];
  std::vector<float> depths;
  for (std::size_t p = 0; p < truth.size(); ++p) {
    const double x = scene.grid.x().at(static_cast<double>(p % scene.grid.size));
    const double y = scene.grid.y().at(static_cast<double>(p / scene.grid.size));
    if (layer(static_cast<int>(p)) == 1 &&
        std::abs(x - plate.x) * plate.depth_m < held.width_m / 2 &&
        std::abs(y - plate.y) * plate.depth_m < held.height_m / 2)
      depths.push_back(truth[p]);
  }
  if (!depths.empty()) plate.depth_m = double{quantile(depths, 0.5)};
  return plate;
}

double read_letter(std::span<const float> map, const Scene& scene, const Plate& plate) {
  const int reach = 2 * cells_of(most_shift_m);
  const auto& size = letter_sizes[plate.size];
  const Cells patch =
      patch_of(near_layer(map, plate.depth_m, scene), scene, plate,
               {cells_of(size.width_m) + 2 + reach, cells_of(size.height_m) + 2 + reach});
  std::array<double, letters.size()> alike{};
  for (std::size_t k = 0; k < letters.size(); ++k)
    alike[k] = best_match(patch, template_of(k, plate.size, scene.grid)).first;
  const double own = alike[plate.letter];
  if (std::any_of(alike.begin(), alike.end(), [&](double a) { return a > own; })) return 0;
  return 1 / static_cast<double>(std::count(alike.begin(), alike.end(), own));
}

}  // namespace echofuse::recon
