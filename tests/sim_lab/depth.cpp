// SPDX-License-Identifier: MIT
// Reads the simulated depth camera through the real OpenNI2 library, in a separate process.
#include <sys/wait.h>

#include <cstdio>

#include "drivers/core/bytes.hpp"
#include "lab_thread.hpp"

using namespace echofuse::test;

namespace {

class Reader {
 public:
  Reader(const std::string& lab_dir, const std::string& file, const std::string& arguments) {
    const auto folder = std::filesystem::read_symlink("/proc/self/exe").parent_path();
    // Suppresses sanitizer reports about OpenNI2, because OpenNI2 leaks memory and is built without
    // ThreadSanitizer.
    const std::string sanitizers = "ASAN_OPTIONS=detect_leaks=0 TSAN_OPTIONS=suppressions='" +
                                   source_dir + "/tests/tsan.supp' ";
    const std::string command = sanitizers + "LD_LIBRARY_PATH='" + lab_dir + "/openni' '" +
                                (folder / "depth_reader").string() + "' '" + file + "' " +
                                arguments;
    pipe_ = ::popen(command.c_str(), "r");
    REQUIRE(pipe_);
  }
  ~Reader() {
    if (pipe_) ::pclose(pipe_);
  }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;

  // Returns the next line of the program's output, or an empty string at the end of the output.
  std::string line() {
    char text[256];
    if (!std::fgets(text, sizeof text, pipe_)) return {};
    std::string all = text;
    all.pop_back();
    return all;
  }
  std::string line_with(const std::string& beginning) {
    for (std::string text = line(); !text.empty(); text = line()) {
      INFO(text);
      REQUIRE(text.rfind("error", 0) != 0);
      if (text.rfind(beginning, 0) == 0) return text;
    }
    return {};
  }
  int exit_code() {
    const int status = ::pclose(std::exchange(pipe_, nullptr));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  std::FILE* pipe_;
};

// Renders the expected depth image. The explicit axes describe a camera with 320 x 240 pixels and
// half tangents of 0.8 and 0.6. The pixel centres are 0.005 apart.
std::vector<std::uint16_t> expected_picture(const sim::LabOptions& options) {
  const Axis x{"depth_x", "tangent", "1", 320, -159.5 * 0.005, 0.005};
  const Axis y{"depth_y", "tangent", "1", 240, 119.5 * 0.005, -0.005};
  const auto scene = sim::make_scene(options.conditions, sim::SceneKind::person,
                                     static_cast<std::uint64_t>(options.schedule.seed), 0);
  return sim::render_depth_mm(scene, x, y);
}

std::vector<std::uint16_t> read_picture(const std::string& path) {
  const std::string raw = contents(path);
  return to_values<std::uint16_t>({reinterpret_cast<const std::uint8_t*>(raw.data()), raw.size()});
}

}  // namespace

TEST_CASE("the simulated depth camera delivers 30 frames of the scene per second") {
  const Folder dir;
  const sim::LabOptions options = options_in(dir, {"person", 21, 0});
  LabThread lab(options);
  Reader reader(options.dir, dir / "picture", "16 0");
  CHECK(reader.line_with("mode") == "mode 320 240 30 100 fov 1.349482 1.080839");
  int first_index = 0, index = 0, stride = 0;
  unsigned long long first_us = 0, time_us = 0;
  for (int i = 0; i < 16; ++i) {
    REQUIRE(std::sscanf(reader.line_with("index").c_str(), "index %d time %llu stride %d", &index,
                        &time_us, &stride) == 3);
    CHECK(stride == 640);
    if (i == 0) first_index = index, first_us = time_us;
  }
  CHECK(index - first_index >= 15);
  const double period_s = static_cast<double>(time_us - first_us) * 1e-6 / (index - first_index);
  CHECK(period_s == Approx(1.0 / 30).epsilon(0.1));
  REQUIRE(reader.line_with("frame") == "frame");
  CHECK(reader.exit_code() == 0);

  const auto expected = expected_picture(options);
  CHECK(std::count_if(expected.begin(), expected.end(), [](auto z) { return z > 0; }) > 500);
  CHECK(read_picture(dir / "picture") == expected);
}

TEST_CASE("the simulated depth camera exists only while the simulated laboratory is running") {
  const Folder dir;
  sim::LabOptions options = options_in(dir, {"person", 21, 0});
  auto lab = std::make_unique<LabThread>(options);
  Reader reader(options.dir, dir / "picture", "1 1");
  REQUIRE(reader.line_with("frame") == "frame");
  lab.reset();
  REQUIRE(reader.line_with("gone") == "gone");
  options.schedule.seed = 22;
  lab = std::make_unique<LabThread>(options);
  REQUIRE(reader.line_with("back") == "back");
  REQUIRE(reader.line_with("frame") == "frame");
  CHECK(reader.exit_code() == 0);
  CHECK(read_picture(dir / "picture") == expected_picture(options));
}
