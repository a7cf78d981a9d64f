// SPDX-License-Identifier: MIT
#include "acquire/measurement/depth_map.hpp"

#include "../catch.hpp"
#include "drivers/util/exit_code.hpp"

using namespace echofuse::record;

namespace {
using Image = std::vector<std::uint16_t>;
}

TEST_CASE("a depth map that is resampled to its own axes does not change") {
  const Axis x = MapGrid{}.x(), y = MapGrid{}.y();
  CHECK(x.at(0) == Approx(-0.55 * 63 / 64));
  CHECK(y.at(0) == Approx(0.55 * 63 / 64));
  CHECK(x.at(63) == Approx(-x.at(0)));
  Image image(64 * 64);
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<std::uint16_t>(i);
  const auto map = to_target(image, x, y, {64, 0.55, 65});
  for (std::size_t i = 0; i < image.size(); ++i) REQUIRE(map[i] == static_cast<float>(i) / 1000.0f);
}

TEST_CASE("the map grid is read from the three map axes of a run, or has default values") {
  const MapGrid grid{100, 0.3, 23};
  const auto axes = grid.axes();
  CHECK(map_grid_of(axes) == grid);
  CHECK(axes[0].at(0) == Approx(grid.x().at(0)));
  CHECK(axes[1].at(99) == Approx(grid.y().at(99)));
  CHECK(axes[2].at(1) == 23);
  // Runs that lack the axis map_z use the default depth range.
  CHECK(map_grid_of(std::span(axes).first(2)) == MapGrid{100, 0.3, 6});
  CHECK(map_grid_of({}) == MapGrid{64, 0.55, 6});
  for (const MapGrid& other : {MapGrid{100, 0.301, 23}, {99, 0.3, 23}, {100, 0.3, 24}})
    CHECK_FALSE(grid == other);
  CHECK_THROWS_AS(map_grid_of(std::span(axes).first(1)), Error);
  for (const MapGrid& wrong : {MapGrid{300, 0.3}, {64, 4}, {64, 0.3, 66}})
    CHECK_THROWS_AS(map_grid_of(wrong.axes()), Error);
}

TEST_CASE("each source pixel is used in exactly one target pixel, and invalid pixels are ignored") {
  const Axis x = depth_x_axis(256, 0.55), y = depth_y_axis(256, 0.55);
  Image image(256 * 256, 3000);
  for (std::size_t j = 0; j < 256; ++j)
    for (std::size_t i = 0; i < 256; ++i) {
      // A target pixel is not affected if a quarter of its source pixels are missing.
      if (i % 4 == 3) image[j * 256 + i] = 0;
      // A target pixel has no depth if three quarters of its source pixels are missing.
      if (j < 4) image[j * 256 + i] = i % 4 < 3 ? 0 : 2500;
      if (j >= 252) image[j * 256 + i] = 6001;  // 6001 mm is beyond the depth range of 6 m
    }
  const auto map = to_target(image, x, y, {});
  CHECK(map[10] == 0.0f);
  CHECK(map[64 * 63 + 10] == 0.0f);
  for (std::size_t i = 64; i < 64 * 63; ++i) REQUIRE(map[i] == 3.0f);
  CHECK(to_target(image, x, y, {64, 0.55, 7})[64 * 63 + 10] == 6.001f);
}

TEST_CASE("map pixels outside the camera's field of view are empty") {
  const Axis x = depth_x_axis(64, 0.275), y = depth_y_axis(64, 0.275);
  Image image(64 * 64, 2000);
  // Sets the upper half of the image to 4 m.
  for (std::size_t i = 0; i < 64 * 32; ++i) image[i] = 4000;
  const auto map = to_target(image, x, y, {});
  CHECK(map[32 * 64 + 15] == 0.0f);
  CHECK(map[31 * 64 + 16] == 4.0f);
  CHECK(map[32 * 64 + 16] == 2.0f);
  CHECK(map[15 * 64 + 32] == 0.0f);
  CHECK(map[16 * 64 + 47] == 4.0f);
  CHECK(map[16 * 64 + 48] == 0.0f);
}
