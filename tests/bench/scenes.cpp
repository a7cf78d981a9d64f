// SPDX-License-Identifier: MIT
// Benchmark of complete simulated records and their parts, on one core. Prints the best of 5
// rounds. The option --people prints people and depth maps as numbers instead.
#include <cstdio>
#include <functional>

#include "../fixtures/record.hpp"
#include "acquire/measurement/depth_map.hpp"
#include "limits.hpp"
#include "sim/dataset/generator.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"

using namespace echofuse;
using namespace echofuse::sim;
using namespace echofuse::test;

namespace {

constexpr std::int64_t scenes = 400;

double best_us(const std::function<void(std::int64_t)>& work) {
  return 1e6 / scenes * bench::best_s(5, [&] {
           for (std::int64_t i = 0; i < scenes; ++i) work(i);
         });
}

// Renders coherent echoes for eight antennas, with range cells of 50 cm and 4.4 cm.
void measure_antennas(const char* background) {
  for (const double cell_m : {0.5, 0.044}) {
    Plan plan;
    plan.people = scenes / 4;
    plan.letters = scenes - plan.people;
    Conditions& c = plan.conditions;
    c.background = background;
    c.radar_antennas = 8;
    c.radar_sum = "coherent";
    c.radar_resolution_m = cell_m;
    c.radar_step_m = cell_m / 2;
    c.radar_bins = static_cast<std::int64_t>(7.25 / c.radar_step_m);
    const Generator generator(plan);
    double sum = 0;
    const double us = best_us([&](std::int64_t i) { sum += antenna_data(generator.make(i))[14]; });
    char name[64];
    std::snprintf(name, sizeof name, "whole record, 8 antennas, %g cm", 100 * cell_m);
    std::printf("%-6s %-34s %8.0f us %8.0f /s\n", background, name, us, 1e6 / us);
    if (sum == 0) std::printf("nothing was seen\n");
  }
}

void measure(const char* background) {
  Plan plan;
  plan.people = scenes / 4;
  plan.letters = scenes - plan.people;
  plan.conditions.background = background;
  const Conditions& c = plan.conditions;
  const Generator generator(plan);
  const auto x = map_grid(c).x(), y = map_grid(c).y();
  const RadarAxis radar = radar_response(c);
  double sum = 0;
  Returns returns;
  const auto light = [&](std::int64_t i) -> const Returns& {
    spd_returns(generator.scene(i), c, returns);
    return returns;
  };
  const auto row = [&](const char* name, const std::function<void(std::int64_t)>& work) {
    const double us = best_us(work);
    std::printf("%-6s %-34s %8.0f us %8.0f /s\n", background, name, us, 1e6 / us);
    return us;
  };
  row("scene", [&](std::int64_t i) { sum += generator.scene(i).capsules[0].radius_m; });
  row("scene, light on the detector", [&](std::int64_t i) { sum += light(i).weight[0]; });
  const double histogram_us = row("scene, histogram without noise",
                                  [&](std::int64_t i) { sum += spd_rate(light(i), c)[90]; });
  row("scene, radar profile without noise", [&](std::int64_t i) {
    radar_returns(generator.scene(i), c, returns);
    sum += radar_power(returns, radar)[14];
  });
  const double map_us = row("scene, depth map", [&](std::int64_t i) {
    sum += render_depth_mm(generator.scene(i), x, y)[2000];
  });
  if (plan.conditions.background == "none") {
    bench::print_row("simulated histogram", "us", histogram_us, 0, "");
    bench::print_row("simulated depth map", "us", map_us, 0, "");
  }
  const double whole_us =
      row("whole record", [&](std::int64_t i) { sum += power(generator.make(i))[14]; });
  bench::print_row(plan.conditions.background == "none" ? "simulated record, open room"
                                                        : "simulated record, furnished room",
                   "records/s", 1e6 / whole_us, 0, "");
  if (sum == 0) std::printf("nothing was seen\n");
}

// Prints people and their depth maps, for comparison with a second renderer.
void print_people() {
  const Conditions c;
  std::printf("rays %d\n", static_cast<int>(rays_of(c)));
  for (std::uint64_t i = 0; i < 10; ++i) {
    const Scene scene = make_scene(c, SceneKind::person, 1, i);
    std::printf("person\n");
    for (const auto& k : scene.capsules)
      std::printf("capsule %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g\n", k.a.x, k.a.y, k.a.z,
                  k.b.x, k.b.y, k.b.z, k.radius_m, k.albedo);
    std::printf("map");
    for (const int mm : render_depth_mm(scene, record::MapGrid{}.x(), record::MapGrid{}.y()))
      std::printf(" %d", mm);
    std::printf("\n");
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "--people") {
    print_people();
    return 0;
  }
  measure("none");
  measure("room");
  measure_antennas("none");
  measure_antennas("room");
}
