// SPDX-License-Identifier: MIT
// Body frame: a grid of cells that moves sideways with a body. Columns are lateral positions
// relative to the body, rows are heights relative to the camera, in metres at the body's depth. A
// body cut out of a map looks the same at any position; draw() puts it back into a map.
#pragma once
#include <optional>
#include <span>
#include <vector>

#include "acquire/measurement/depth_map.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

struct Place {
  float tangent = 0;  // mean x / z of the foreground
  float depth_m = 0;  // mean z of the foreground
};

// Returns the position of the foreground in a ground-truth map (metrics/scene_model.hpp), or
// std::nullopt if the map has no foreground.
std::optional<Place> place_of(std::span<const float> map, std::span<const float> background,
                              const record::MapGrid& grid);

class BodyFrame {
 public:
  BodyFrame() = default;
  // Makes the frame large enough for the bodies in these maps. Its cells are as large as a pixel at
  // the mean depth of the bodies. places[i] belongs to rows[i].
  BodyFrame(const Matrix& maps, std::span<const float> background, const Rows& rows,
            const std::vector<Place>& places, const record::MapGrid& grid);

  std::size_t size() const { return columns_ * rows_; }
  // Cuts the body out of a map: writes the foreground fraction of each cell to `mask`, and that
  // fraction times (z - place.depth_m) to `relief`.
  void cut(std::span<const float> map, std::span<const float> background, const Place& place,
           std::span<float> mask, std::span<float> relief) const;
  // Draws a body onto a background map. Pixels with a mask above the threshold become foreground,
  // at the depth place.depth_m + relief / mask.
  void draw(std::span<const float> mask, std::span<const float> relief, const Place& place,
            float threshold, std::span<float> map) const;
  // Draws without a threshold: writes the mask (0 to 1) of each pixel to `share`, and the depth of
  // the body to `depth`.
  void draw_soft(std::span<const float> mask, std::span<const float> relief, const Place& place,
                 std::span<float> share, std::span<float> depth) const;
  // Returns the number of multiply-adds of one draw().
  std::size_t draw_cost() const;

  void archive(Archive archive, const record::MapGrid& grid);

 private:
  // Draws the body on pixels with a mask above `threshold`. If `share` is not empty, also writes
  // the mask of all pixels to `share`.
  void draw_onto(std::span<const float> mask, std::span<const float> relief, const Place& place,
                 float threshold, std::span<float> map, std::span<float> share) const;

  record::MapGrid grid_;  // grid of the maps
  std::size_t columns_ = 0, rows_ = 0;
  // Position of the centre of cell (0, 0), and side length of a cell, m.
  double left_m_ = 0, top_m_ = 0, pitch_m_ = 1;
};

}  // namespace echofuse::recon
