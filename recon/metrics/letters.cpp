// SPDX-License-Identifier: MIT
#include "recon/metrics/letters.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace echofuse::recon {
namespace {

constexpr double cell_m = 0.02, most_shift_m = 0.08;
constexpr double blur_depth_m = 3;  // depth at which templates are blurred by one pixel of the map
constexpr double middle_behind_nearest_m = 0.1;
constexpr double near_m = 0.2;

using record::letter_sizes;
using Cells = cv::Mat1f;

int cells_of(double length_m) { return static_cast<int>(std::lround(length_m / cell_m)); }

// Draws the letter on its plate and one cell about it, four times as fine.
Cells template_of(std::size_t letter, std::size_t size, const record::MapGrid& grid) {
  constexpr int fine = 4;
  const int columns = cells_of(letter_sizes[size].width_m) + 2;
  const int rows = cells_of(letter_sizes[size].height_m) + 2;
  Cells drawn(fine * rows, fine * columns, 0.f), out;
  const cv::Point middle(fine * columns / 2, fine * rows / 2);
  for (const auto& s : record::letter_strokes(letters[letter], letter_sizes[size])) {
    const cv::Point2d a(s.u0, -s.v0), b(s.u1, -s.v1), along = b - a;
    const cv::Point2d across = cv::Point2d(-along.y, along.x) * (s.width_m / 2 / cv::norm(along));
    std::vector<cv::Point> corners;
    for (const cv::Point2d& c : {a + across, b + across, b - across, a - across})
      corners.push_back(middle + cv::Point(c * (fine / cell_m)));
    cv::fillConvexPoly(drawn, corners, 1.f);
  }
  const int wide = 1 + 2 * static_cast<int>(fine * grid.step() * blur_depth_m / cell_m / 2);
  cv::blur(drawn, drawn, {wide, wide}, {-1, -1}, cv::BORDER_CONSTANT);
  cv::resize(drawn, out, {columns, rows}, 0, 0, cv::INTER_AREA);
  return out;
}

// Cuts the near layer into cells about a place: 1 where the map shows something there or before it.
Cells near_layer(std::span<const float> map, const Scene& scene, const Plate& about,
                 cv::Size cells) {
  const auto side = static_cast<int>(scene.grid.size);
  const auto shares = foreground_share(map, scene);
  Cells layer(side, side, 0.f), out;
  for (std::size_t p = 0; p < shares.size(); ++p)
    layer(static_cast<int>(p)) = shares[p] > 0.5f && double{map[p]} < about.depth_m + near_m;
  const double pixels = cell_m / about.depth_m / scene.grid.step(), middle = (side - 1) / 2.0;
  const double x = middle + about.x / scene.grid.step() - pixels * (cells.width - 1) / 2.0;
  const double y = middle - about.y / scene.grid.step() - pixels * (cells.height - 1) / 2.0;
  cv::warpAffine(layer, out, cv::Matx23d(pixels, 0, x, 0, pixels, y), cells,
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
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
  float nearest_m = INFINITY;
  for (std::size_t p = 0; p < truth.size(); ++p)
    if (true_foreground(truth[p], scene.background[p])) nearest_m = std::min(nearest_m, truth[p]);
  if (std::isinf(nearest_m)) return std::nullopt;
  Plate out{letter, 0, 0, 0, double{nearest_m} + middle_behind_nearest_m};
  const int side = cells_of(2 * scene.grid.half_tangent * out.depth_m);
  const Cells layer = near_layer(truth, scene, out, {side, side});
  double best = 0;
  for (std::size_t size = 0; size < letter_sizes.size(); ++size) {
    const auto [match, off] = best_match(layer, template_of(letter, size, scene.grid));
    if (match <= best) continue;
    best = match, out.size = size;
    out.x = off.x * cell_m / out.depth_m, out.y = -off.y * cell_m / out.depth_m;
  }
  return out;
}

double read_letter(std::span<const float> map, const Scene& scene, const Plate& plate) {
  const int reach = 2 * cells_of(most_shift_m) + 2;
  const auto& size = letter_sizes[plate.size];
  const Cells patch = near_layer(map, scene, plate,
                                 {cells_of(size.width_m) + reach, cells_of(size.height_m) + reach});
  std::array<double, letters.size()> alike{};
  for (std::size_t k = 0; k < letters.size(); ++k)
    alike[k] = best_match(patch, template_of(k, plate.size, scene.grid)).first;
  const double own = alike[plate.letter];
  if (*std::ranges::max_element(alike) > own) return 0;
  return 1 / static_cast<double>(std::ranges::count(alike, own));
}

}  // namespace echofuse::recon
