// SPDX-License-Identifier: MIT
// Letters are read off maps: what the simulator draws, what is drawn wrongly, and what is not
// there.
#include "recon/metrics/letters.hpp"

#include "recon/use/evaluate.hpp"
#include "world.hpp"

using namespace echofuse;
using namespace echofuse::recon;
using namespace echofuse::testing;

namespace {

// People with letters as the simulator makes them; only their depth maps matter.
Dataset simulated_letters(int map_size) {
  const Folder dir;
  const std::string command =
      echofuse::test::bin_dir + "/echofuse-sim dataset -q --letters 60 " +
      "--seed 3 --set spd_rays=16 --set radar_rays=16 --set map_size=" + std::to_string(map_size) +
      " --out " + (dir / "run");
  REQUIRE(std::system(command.c_str()) == 0);
  return load({dir / "run"});
}

}  // namespace

TEST_CASE("a label names a letter, or does not") {
  CHECK(letter_of("letter:A") == 0u);
  CHECK(letter_of("letter:X") == 9u);
  for (const char* label : {"letter:B", "letter:", "letter:AC", "person", "", "a letter:A"})
    CHECK_FALSE(letter_of(label));
}

TEST_CASE("the simulator's letters are read off its maps, and none off an empty one") {
  const Dataset data = simulated_letters(256);
  const Rows rows = all_rows(data.size());
  const Scene scene = learn_scene(data.depth, rows, data.map);
  const Plates plates = find_plates(data, rows, scene);
  const auto read = [&](const Matrix& maps) {
    return summarise(score_maps(maps, data, rows, scene, plates))[metric_letter_top1];
  };
  CHECK(read(data.depth).maps == data.size());
  CHECK(read(data.depth).mean > 0.85);
  CHECK(read(Matrix(data.size(), data.depth.cols)).mean == Approx(0.1));
}
