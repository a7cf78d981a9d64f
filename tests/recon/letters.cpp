// SPDX-License-Identifier: MIT
// Letters are read off maps: what the simulator draws, what is drawn wrongly, and what is not
// there.
#include "recon/maps/letters.hpp"

#include "recon/estimator/evaluate.hpp"
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
  LettersRead read;
  const Summaries seen =
      summarise(score_maps(data.depth, data, rows, scene, find_plates(data, rows, scene), &read));
  CHECK(seen[metric_letter_top1].mean > 0.85);
  CHECK(seen[metric_letter_top3].mean > 0.95);
  std::size_t right = 0;
  for (std::size_t i = 0; i < letters.size(); ++i) right += read.confusion[i][i];
  CHECK(static_cast<double>(right) ==
        Approx(seen[metric_letter_top1].mean * static_cast<double>(data.size())));
  LettersRead unread;
  const Matrix none(data.size(), data.depth.cols);
  const Summaries nothing =
      summarise(score_maps(none, data, rows, scene, find_plates(data, rows, scene), &unread));
  CHECK(nothing[metric_letter_top1].mean == Approx(0.1));
  CHECK(nothing[metric_letter_top3].mean == Approx(0.3));
  std::size_t counted = 0;
  for (const auto& row : unread.confusion) counted += row[letters.size()];
  CHECK(counted == data.size());
}
