// SPDX-License-Identifier: MIT
// Reads the simulated depth camera through the real OpenNI2 library, in a separate process.
#include <cstdio>
#include <future>

#include "../drivers/sink.hpp"
#include "../fixtures/shell.hpp"
#include "drivers/core/bytes.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;

namespace {

Outcome read_camera(const sim::LabOptions& options, const std::string& arguments) {
  const auto folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
  // Suppresses sanitizer reports about OpenNI2, because OpenNI2 leaks memory and is built without
  // ThreadSanitizer.
  return shell("ASAN_OPTIONS=detect_leaks=0 TSAN_OPTIONS=suppressions='" + source_dir +
               "/tests/tsan.supp' LD_LIBRARY_PATH='" + options.dir + "/openni' '" +
               (folder / "depth_reader").string() + "' " + arguments);
}

// Checks that the picture shows the scene of the laboratory.
void check_picture(const std::string& path, const sim::LabOptions& options) {
  // The explicit axes describe a camera with 320 x 240 pixels and half tangents of 0.8 and 0.6. The
  // pixel centres are 0.005 apart.
  const Axis x{"depth_x", "tangent", "1", 320, -159.5 * 0.005, 0.005};
  const Axis y{"depth_y", "tangent", "1", 240, 119.5 * 0.005, -0.005};
  const auto scene = sim::make_scene(options.conditions, sim::SceneKind::person,
                                     static_cast<std::uint64_t>(options.schedule.seed), 0);
  const auto expected = sim::render_depth_mm(scene, x, y);
  CHECK(std::ranges::count_if(expected, [](auto z) { return z > 0; }) > 500);
  const std::string raw = contents(path);
  CHECK(to_values<std::uint16_t>({reinterpret_cast<const std::uint8_t*>(raw.data()), raw.size()}) ==
        expected);
}

}  // namespace

TEST_CASE("the simulated depth camera delivers 30 frames of the scene per second") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 21, 0});
  LabThread lab(options);
  const Outcome o = read_camera(options, dir / "picture 16 0");
  CAPTURE(o.text);
  CHECK(o.code == 0);
  CHECK(o.text.starts_with("mode 320 240 30 100 fov 1.349482 1.080839\n"));
  std::istringstream lines(o.text);
  int first = 0, index = 0, stride = 0;
  unsigned long long first_us = 0, time_us = 0;
  for (std::string line; std::getline(lines, line);) {
    std::sscanf(line.c_str(), "index %d time %llu stride %d", &index, &time_us, &stride);
    if (first == 0) first = index, first_us = time_us;
  }
  CHECK(stride == 640);
  CHECK(index - first >= 15);
  const double period_s = static_cast<double>(time_us - first_us) * 1e-6 / (index - first);
  CHECK(period_s == Approx(1.0 / 30).epsilon(0.1));
  check_picture(dir / "picture", options);
}

TEST_CASE("the simulated depth camera exists only while the simulated laboratory is running") {
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 21, 0});
  auto lab = std::make_unique<LabThread>(options);
  auto reading =
      std::async([&, first = options] { return read_camera(first, dir / "picture 1 1"); });
  port::SystemLoop loop;
  REQUIRE(run_until(loop, [&] {
    loop.run_for(std::chrono::milliseconds(10));
    return std::filesystem::exists(dir / "picture");
  }));
  lab.reset();
  options.schedule.seed = 22;
  lab = std::make_unique<LabThread>(options);
  const Outcome o = reading.get();
  CAPTURE(o.text);
  CHECK(o.code == 0);
  check_picture(dir / "picture", options);
}
