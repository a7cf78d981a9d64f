// SPDX-License-Identifier: MIT
// A body frame is a patch of space that moves along with a body: columns in metres to its right,
// rows in metres above the camera, both at the body's depth. Cut from a map it holds what people
// look like wherever they stand; drawn into a map it puts them back.
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

// Returns the place of a true map's foreground (metrics/scene.hpp), or nothing if there is no
// foreground.
std::optional<Place> place_of(std::span<const float> map, std::span<const float> background,
                              const record::MapGrid& grid);

class BodyFrame {
 public:
  BodyFrame() = default;
  // The frame is as large as the bodies in these maps, and its cells are as large as their pixels.
  // `rows` and `places` belong together.
  BodyFrame(const Matrix& maps, std::span<const float> background, const Rows& rows,
            const std::vector<Place>& places, const record::MapGrid& grid);

  std::size_t size() const { return columns_ * rows_; }
  // `mask` gets the share of each cell that is foreground; `relief` gets that share times (z -
  // place.depth_m).
  void cut(std::span<const float> map, std::span<const float> background, const Place& place,
           std::span<float> mask, std::span<float> relief) const;
  // Draws onto a map of the background. Foreground is where the mask exceeds the threshold, at
  // depth_m + relief / mask.
  void draw(std::span<const float> mask, std::span<const float> relief, const Place& place,
            float threshold, std::span<float> map) const;
  // Same without a threshold: each pixel gets the mask's share in 0..1 and the depth there.
  void draw_soft(std::span<const float> mask, std::span<const float> relief, const Place& place,
                 std::span<float> share, std::span<float> depth) const;
  // Returns the multiply-adds of one draw().
  std::size_t draw_cost() const;

  void archive(Archive archive, const record::MapGrid& grid);

 private:
  // Draws the body where its mask exceeds `least`. A `share` with room gets the mask wherever the
  // cells reach.
  void draw_onto(std::span<const float> mask, std::span<const float> relief, const Place& place,
                 float least, std::span<float> map, std::span<float> share) const;

  record::MapGrid grid_;  // grid of the maps
  std::size_t columns_ = 0, rows_ = 0;
  double left_m_ = 0, top_m_ = 0, pitch_m_ = 1;  // centre of cell (0, 0), distance of the cells
};

}  // namespace echofuse::recon
