// SPDX-License-Identifier: MIT
#include "recon/maps/letters.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <numeric>
#include <utility>

namespace echofuse::recon {
namespace {

constexpr double cell_m = 0.02, template_depth_m = 3, most_shift_m = 0.08;
// Before a plate is found: its middle is that far behind what is nearest, a shoe at times.
constexpr double middle_behind_nearest_m = 0.1;
constexpr float near_m = 0.15f, far_m = 0.35f;

using record::letter_sizes;
using record::Stroke;

bool covers(const Stroke& s, double x, double y) {
  const double dx = s.u1 - s.u0, dy = s.v1 - s.v0, length = std::hypot(dx, dy);
  const double along = ((x - s.u0) * dx + (y - s.v0) * dy) / length;
  const double across = ((x - s.u0) * dy - (y - s.v0) * dx) / length;
  return along >= 0 && along <= length && std::abs(across) <= s.width_m / 2;
}

// Of cell i of n about their middle.
double offset_m(std::size_t i, std::size_t n) {
  return (static_cast<double>(i) - (static_cast<double>(n) - 1) / 2) * cell_m;
}

// Share of a square around each cell that the letter covers.
std::vector<float> coverage_of(const std::vector<Stroke>& strokes, std::size_t columns,
                               std::size_t rows, double blur_m) {
  constexpr int samples = 8;
  std::vector<float> out(columns * rows);
  for (std::size_t c = 0; c < out.size(); ++c) {
    int inside = 0;
    for (int i = 0; i < samples * samples; ++i) {
      const double dx = ((i % samples + 0.5) / samples - 0.5) * (cell_m + blur_m);
      const double dy = ((i / samples + 0.5) / samples - 0.5) * (cell_m + blur_m);
      const double x = offset_m(c % columns, columns) + dx, y = dy - offset_m(c / columns, rows);
      inside += std::any_of(strokes.begin(), strokes.end(),
                            [&](const Stroke& s) { return covers(s, x, y); });
    }
    out[c] = static_cast<float>(inside) / (samples * samples);
  }
  return out;
}

void normalise(std::vector<float>& values) {
  double mean = 0, squares = 0;
  for (const float v : values) mean += double{v} / static_cast<double>(values.size());
  for (float& v : values) v -= static_cast<float>(mean), squares += double{v} * double{v};
  for (float& v : values) v /= static_cast<float>(std::sqrt(squares));
}

// 1 at the plate's depth or before it, 0 far behind it and where there is nothing.
std::vector<float> near_layer(std::span<const float> map, double depth_m, const Scene& scene) {
  std::vector<float> out = foreground_share(map, scene);
  const auto middle_m = static_cast<float>(depth_m);
  for (std::size_t p = 0; p < out.size(); ++p)
    out[p] =
        out[p] > 0.5f ? std::clamp((middle_m + far_m - map[p]) / (far_m - near_m), 0.f, 1.f) : 0.f;
  return out;
}

// A layer in cells about a place, whose tangents these are: linear between the pixels, 0 outside.
struct Patch {
  std::size_t columns, rows;
  std::vector<float> cells;
  Patch(const std::vector<float>& layer, const record::MapGrid& grid, double depth_m, double x,
        double y, std::size_t wide, std::size_t high)
      : columns(wide), rows(high), cells(wide * high) {
    const auto side = static_cast<std::ptrdiff_t>(grid.size);
    const auto pixel = [&](std::ptrdiff_t column, std::ptrdiff_t row) {
      const bool inside = column >= 0 && column < side && row >= 0 && row < side;
      return inside ? double{layer[static_cast<std::size_t>(row * side + column)]} : 0.0;
    };
    const Axis across = grid.x(), down = grid.y();
    for (std::size_t c = 0; c < cells.size(); ++c) {
      const double column = (x + offset_m(c % wide, wide) / depth_m - across.start) / across.step;
      const double row = (y - offset_m(c / wide, high) / depth_m - down.start) / down.step;
      const auto i = static_cast<std::ptrdiff_t>(std::floor(column));
      const auto j = static_cast<std::ptrdiff_t>(std::floor(row));
      const double u = column - static_cast<double>(i), v = row - static_cast<double>(j);
      cells[c] = static_cast<float>((1 - v) * ((1 - u) * pixel(i, j) + u * pixel(i + 1, j)) +
                                    v * ((1 - u) * pixel(i, j + 1) + u * pixel(i + 1, j + 1)));
    }
  }
};

// Of the plate's search: templates are blurred by about so many cells.
constexpr std::size_t search_stride = 2;

struct Match {
  double similarity = 0;         // 0 if nowhere is anything to be seen
  double right_m = 0, up_m = 0;  // of the patch's middle
};

// A patch as seen through a window of the templates' size.
class Windows {
 public:
  Windows(const Patch& patch, std::size_t columns, std::size_t rows)
      : across(patch.columns - columns + 1),
        down(patch.rows - rows + 1),
        patch_(patch),
        columns_(columns),
        rows_(rows),
        deviation_(across * down, unknown) {}

  // How alike the template, normalised, is to the window with this corner; 0 where nothing is.
  double similarity(std::size_t left, std::size_t top, const std::vector<float>& cells) {
    float& deviation = deviation_[top * across + left];
    if (deviation == unknown) deviation = deviation_at(left, top);
    if (deviation == 0) return 0;
    Row sums{};
    for (std::size_t r = 0; r < rows_; ++r) {
      const float *own = &cells[r * columns_], *seen = row(left, top + r);
      for (std::size_t c = 0; c < columns_; ++c) sums[c] += own[c] * seen[c];
    }
    return double{total(sums)} / double{deviation};
  }

  const std::size_t across, down;  // corners

 private:
  static constexpr float unknown = -1;
  // Sums a column: those run side by side in the processor's vectors.
  static constexpr std::size_t most_columns = 32;
  static_assert(letter_sizes[0].width_m / cell_m + 3 < most_columns &&
                letter_sizes[1].width_m / cell_m + 3 < most_columns);
  using Row = std::array<float, most_columns>;

  const float* row(std::size_t left, std::size_t row) const {
    return &patch_.cells[row * patch_.columns + left];
  }

  static float total(const Row& sums) { return std::accumulate(sums.begin(), sums.end(), 0.f); }

  // The square root of the sum of squares about the mean.
  float deviation_at(std::size_t left, std::size_t top) const {
    constexpr float least_variation = 1e-3f;
    const auto count = static_cast<float>(columns_ * rows_);
    Row sums{}, squares{};
    for (std::size_t r = 0; r < rows_; ++r) {
      const float* seen = row(left, top + r);
      for (std::size_t c = 0; c < columns_; ++c)
        sums[c] += seen[c], squares[c] += seen[c] * seen[c];
    }
    const float sum = total(sums), variation = total(squares) - sum * sum / count;
    return variation < least_variation * count ? 0 : std::sqrt(variation);
  }

  const Patch& patch_;
  const std::size_t columns_, rows_;
  std::vector<float> deviation_;
};

// Where the template is most alike: at every `stride`-th corner, then at all around the best of
// these.
Match best_match(Windows& windows, const std::vector<float>& cells, std::size_t stride = 1) {
  Match best;
  std::size_t best_left = 0, best_top = 0;
  const auto look = [&](std::size_t left, std::size_t top) {
    const double similarity = windows.similarity(left, top, cells);
    if (similarity <= best.similarity) return;
    best = {similarity, offset_m(left, windows.across), -offset_m(top, windows.down)};
    best_left = left, best_top = top;
  };
  for (std::size_t top = 0; top < windows.down; top += stride)
    for (std::size_t left = 0; left < windows.across; left += stride) look(left, top);
  if (stride == 1 || best.similarity == 0) return best;
  const std::size_t near = stride - 1, first_left = best_left - std::min(near, best_left);
  const std::size_t first_top = best_top - std::min(near, best_top);
  const std::size_t last_left = std::min(best_left + near, windows.across - 1);
  const std::size_t last_top = std::min(best_top + near, windows.down - 1);
  for (std::size_t top = first_top; top <= last_top; ++top)
    for (std::size_t left = first_left; left <= last_left; ++left) look(left, top);
  return best;
}

}  // namespace

LetterReader::LetterReader(const record::MapGrid& grid) {
  for (std::size_t size = 0; size < templates_.size(); ++size)
    for (std::size_t letter = 0; letter < letters.size(); ++letter) {
      const auto cells = [](double length_m) {
        return static_cast<std::size_t>(std::lround(length_m / cell_m)) + 2;
      };
      Template& one = templates_[size][letter];
      one.columns = cells(letter_sizes[size].width_m),
      one.rows = cells(letter_sizes[size].height_m);
      one.cells = coverage_of(record::letter_strokes(letters[letter], letter_sizes[size]),
                              one.columns, one.rows, grid.step() * template_depth_m);
      normalise(one.cells);
    }
}

const LetterReader& LetterReader::of(const record::MapGrid& grid) {
  static std::mutex mutex;
  static std::vector<std::pair<record::MapGrid, std::unique_ptr<const LetterReader>>> made;
  const std::lock_guard lock(mutex);
  for (const auto& [known, reader] : made)
    if (known == grid) return *reader;
  return *made.emplace_back(grid, std::make_unique<const LetterReader>(grid)).second;
}

std::optional<LetterReader::Plate> LetterReader::find_plate(std::span<const float> truth,
                                                            const Scene& scene,
                                                            std::size_t letter) const {
  double nearest = 1e9;
  for (std::size_t p = 0; p < truth.size(); ++p)
    if (true_foreground(truth[p], scene.background[p]))
      nearest = std::min(nearest, double{truth[p]});
  if (nearest == 1e9) return std::nullopt;
  const double depth_m = nearest + middle_behind_nearest_m;
  const auto layer = near_layer(truth, depth_m, scene);
  const std::size_t side = scene.grid.size;
  std::size_t left = side, right = 0, top = side, bottom = 0;
  for (std::size_t p = 0; p < layer.size(); ++p) {
    if (layer[p] == 0) continue;
    left = std::min(left, p % side), right = std::max(right, p % side);
    top = std::min(top, p / side), bottom = std::max(bottom, p / side);
  }
  if (left > right) return std::nullopt;
  const auto cells = [&](std::size_t first, std::size_t last) {
    constexpr std::size_t margin = 24, most = 150;  // more than a template
    const double length_m = static_cast<double>(last - first) * scene.grid.step() * depth_m;
    return std::min(margin + static_cast<std::size_t>(length_m / cell_m), most);
  };
  const Axis across = scene.grid.x(), down = scene.grid.y();
  const double x = across.at(static_cast<double>(left + right) / 2);
  const double y = down.at(static_cast<double>(top + bottom) / 2);
  const Patch patch(layer, scene.grid, depth_m, x, y, cells(left, right), cells(top, bottom));
  Match best;
  Plate plate{letter, 0, x, y, depth_m};
  for (std::size_t size = 0; size < templates_.size(); ++size) {
    const Template& own = templates_[size][letter];
    Windows windows(patch, own.columns, own.rows);
    const Match match = best_match(windows, own.cells, search_stride);
    if (match.similarity <= best.similarity) continue;
    best = match;
    plate = {letter, size, x + match.right_m / depth_m, y + match.up_m / depth_m, depth_m};
  }
  // The middle of what is near within the plate.
  std::vector<double> depths;
  for (std::size_t p = 0; p < layer.size(); ++p)
    if (layer[p] == 1 &&
        std::abs(across.at(static_cast<double>(p % side)) - plate.x) * depth_m <
            letter_sizes[plate.size].width_m / 2 &&
        std::abs(down.at(static_cast<double>(p / side)) - plate.y) * depth_m <
            letter_sizes[plate.size].height_m / 2)
      depths.push_back(double{truth[p]});
  if (depths.empty()) return plate;
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  plate.depth_m = *middle;
  return plate;
}

double LetterReader::read(std::span<const float> map, const Scene& scene,
                          const Plate& plate) const {
  const auto& candidates = templates_[plate.size];
  const auto reach = 2 * static_cast<std::size_t>(std::lround(most_shift_m / cell_m));
  const Patch patch(near_layer(map, plate.depth_m, scene), scene.grid, plate.depth_m, plate.x,
                    plate.y, candidates[0].columns + reach, candidates[0].rows + reach);
  Windows windows(patch, candidates[0].columns, candidates[0].rows);
  std::array<double, letters.size()> similarity{};
  for (std::size_t k = 0; k < letters.size(); ++k)
    similarity[k] = best_match(windows, candidates[k].cells).similarity;
  const double own = similarity[plate.letter];
  if (std::any_of(similarity.begin(), similarity.end(), [&](double s) { return s > own; }))
    return 0;
  return 1 / static_cast<double>(std::count(similarity.begin(), similarity.end(), own));
}

}  // namespace echofuse::recon
