// SPDX-License-Identifier: MIT
// Predicts the depth map of one record. Prints the depth of each pixel as one digit, in whole m.
//   ./predict fused.safetensors monday 0
#include <cstdio>
#include <cstdlib>
#include <echofuse/predict.hpp>
#include <exception>

int main(int count, char** words) try {
  if (count != 4) return std::fprintf(stderr, "usage: predict MODEL RUN RECORD\n"), 2;
  const echofuse::Model model(words[1]);
  const echofuse::Run run(words[2]);
  const echofuse::DepthMap map = echofuse::predict(model, run.read(std::atoll(words[3])));
  if (!map.fault.empty()) return std::fprintf(stderr, "no map: %s\n", map.fault.c_str()), 1;
  const std::size_t side = model.grid().size;
  for (std::size_t row = 0; row < side; ++row) {
    for (std::size_t column = 0; column < side; ++column) {
      const float depth_m = map.depth_m[row * side + column];
      std::putchar(depth_m > 0 ? '0' + static_cast<int>(depth_m) % 10 : '.');
    }
    std::putchar('\n');
  }
  if (map.body) std::printf("body at x = %.2f m, z = %.2f m", map.body->x_m, map.body->z_m);
  if (map.body && map.body->lateral_interval_90_m)
    std::printf(", 90 %% interval of x +- %.2f m", *map.body->lateral_interval_90_m);
  std::printf("%s\n", map.body ? "" : "no body");
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
