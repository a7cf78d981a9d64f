// SPDX-License-Identifier: MIT
#include "sim/sensors/depth_camera.hpp"

#include "../catch.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "scenes.hpp"

using namespace echofuse::sim;

TEST_CASE("depth camera noise is Gaussian, grows with the square of the distance, and has a bias") {
  Conditions c;
  c.depth_noise_m = 0.002, c.depth_offset_m = 0.05;
  Rng rng = make_rng(1, 1);
  constexpr std::size_t n = 200'000;
  for (const int mm : {1000, 2000, 4000}) {
    std::vector<std::uint16_t> frame(n, static_cast<std::uint16_t>(mm));
    disturb_depth(frame, 400, c, rng);
    const double z_m = mm / 1000.0;
    // Variance in mm^2. It is caused by noise with a standard deviation of 2 mm * z^2 and by
    // rounding to millimetres.
    const double variance = std::pow(2 * z_m * z_m, 2) + 1.0 / 12;
    double sum = 0, squares = 0;
    for (const auto seen : frame) {
      const double error_mm = seen - mm - 50;
      sum += error_mm;
      squares += error_mm * error_mm;
    }
    CHECK(std::abs(sum) < 4.5 * std::sqrt(n * variance));
    CHECK(std::abs(squares - n * variance) < 4.5 * std::sqrt(2.0 * n) * variance);
  }
}

TEST_CASE(
    "simulated depth camera pixels drop out at depth edges only and with the set probability") {
  Conditions c;
  c.depth_dropout = 0.3;
  Rng rng = make_rng(2, 2);
  constexpr std::size_t width = 100, height = 500;
  // Each row has four regions: one without a return, and three at depths of 2 m, 2.05 m and 3 m.
  std::vector<std::uint16_t> exact(width * height);
  const auto depth_of = [](std::size_t column) -> std::uint16_t {
    return column < 20 ? 0 : column < 40 ? 2000 : column < 60 ? 2050 : 3000;
  };
  for (std::size_t i = 0; i < exact.size(); ++i) exact[i] = depth_of(i % width);
  auto frame = exact;
  disturb_depth(frame, width, c, rng);
  for (std::size_t column = 0; column < width; ++column) {
    double lost = 0;
    for (std::size_t row = 0; row < height; ++row) {
      const auto seen = frame[row * width + column];
      CHECK((seen == 0 || seen == depth_of(column)));
      lost += seen == 0 && depth_of(column) > 0;
    }
    const bool edge = column == 20 || column == 59 || column == 60;
    CAPTURE(column);
    if (!edge) CHECK(lost == 0);
    if (edge) CHECK(std::abs(lost - 0.3 * height) < 4.5 * std::sqrt(0.3 * 0.7 * height));
  }
}

TEST_CASE(
    "a simulated depth map is exact if camera noise is off, else resampled from a noisy frame") {
  Conditions c;
  const Scene scene = some_scene(c, 4);
  const record::MapGrid grid;
  Rng rng = make_rng(3, 3), same = make_rng(3, 3);
  CHECK(depth_map_mm(scene, grid, c, rng) == render_depth_mm(scene, grid.x(), grid.y()));
  CHECK(rng == same);
  c.depth_noise_m = 0.001;
  c.depth_dropout = 0.5;
  const auto seen = depth_map_mm(scene, grid, c, rng);
  const Axis columns = record::depth_x_axis(320, 0.8), rows = record::depth_y_axis(240, 0.6);
  auto frame = render_depth_mm(scene, columns, rows);
  disturb_depth(frame, 320, c, same);
  const auto map = record::to_target(frame, columns, rows, grid);
  for (std::size_t i = 0; i < map.size(); ++i)
    CHECK(seen[i] == static_cast<std::uint16_t>(std::lround(1000 * map[i])));
}
