// SPDX-License-Identifier: MIT
// Body frame: a grid that moves with a body. Columns are metres to its right, rows are metres above
// the camera, both at the body's depth. A body cut out of a map looks the same at any position;
// draw() puts it back into a map.
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct Place {
  float tangent = 0;  // x / z of the foreground's centroid
  float depth_m = 0;  // its mean z
};

// Returns the place of a true map's foreground (metrics/scene_model.hpp), or nothing without a
// foreground.
std::optional<Place> place_of(std::span<const float> map, std::span<const float> background,
                              const record::MapGrid& grid);

class BodyFrame {
 public:
  BodyFrame() = default;
  // Sets the size of the frame to that of the bodies in these maps, and the size of its cells to
  // that of their pixels. places[i] belongs to rows[i].
  BodyFrame(const Matrix& maps, std::span<const float> background, const Rows& rows,
            const std::vector<Place>& places, const record::MapGrid& grid);

  std::size_t size() const { return columns_ * rows_; }
  // Writes the foreground share of each cell to `mask`, and that share times (z - place.depth_m) to
  // `relief`.
  void cut(std::span<const float> map, std::span<const float> background, const Place& place,
           std::span<float> mask, std::span<float> relief) const;
  // Draws onto a background map. Pixels with a mask above the threshold are foreground, at depth_m
  // + relief / mask.
  void draw(std::span<const float> mask, std::span<const float> relief, const Place& place,
            float threshold, std::span<float> map) const;
  // Same without a threshold: writes the mask (0 to 1) and the depth of each pixel.
  void draw_soft(std::span<const float> mask, std::span<const float> relief, const Place& place,
                 std::span<float> share, std::span<float> depth) const;
  // Returns the multiply-adds of one draw().
  std::size_t draw_cost() const;

  void archive(Archive archive, const record::MapGrid& grid);

 private:
  // Draws pixels with a mask above `least`. Writes the mask of all pixels to `share` unless it is
  // empty.
  void draw_onto(std::span<const float> mask, std::span<const float> relief, const Place& place,
                 float least, std::span<float> map, std::span<float> share) const;

  record::MapGrid grid_;  // grid of the maps
  std::size_t columns_ = 0, rows_ = 0;
  double left_m_ = 0, top_m_ = 0, pitch_m_ = 1;  // centre of cell (0, 0); size of a cell
};

}  // namespace echofuse::recon
