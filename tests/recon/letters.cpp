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

double top1_of_truth(const Dataset& data) {
  const Rows rows = all_rows(data.size());
  return summarise(score_maps(take_rows(data.depth, rows), data, rows,
                              learn_scene(data.depth, rows, data.map)))[metric_letter_top1]
      .mean;
}

}  // namespace

TEST_CASE("a label names a letter, or does not") {
  CHECK(letter_of("letter:A") == 0u);
  CHECK(letter_of("letter:X") == 9u);
  for (const char* label : {"letter:B", "letter:", "letter:AC", "person", "", "a letter:A"})
    CHECK_FALSE(letter_of(label));
}

TEST_CASE("the simulator's letters are read off its maps if their pixels are fine enough") {
  const Dataset fine = simulated_letters(256);
  CHECK(top1_of_truth(fine) > 0.95);
  const Rows rows = all_rows(fine.size());
  const Scene scene = learn_scene(fine.depth, rows, fine.map);
  SECTION("a map without anything is read as every letter alike") {
    const Matrix none(fine.size(), fine.depth.cols);
    LettersRead read;
    const Summaries s = summarise(score_maps(none, fine, rows, scene, &read));
    CHECK(s[metric_letter_top1].mean == Approx(0.1));
    CHECK(s[metric_letter_top3].mean == Approx(0.3));
    std::size_t nothing = 0;
    for (const auto& row : read.confusion) nothing += row[letters.size()];
    CHECK(nothing == fine.size());
  }
  SECTION("a letter is not read as the next person's") {
    const LetterReader reader(fine.map);
    std::size_t alike = 0, tried = 0;
    for (std::size_t i = 0; i + 1 < fine.size(); ++i) {
      const auto own = letter_of(fine.label[i]), next = letter_of(fine.label[i + 1]);
      if (own == next) continue;
      const auto reading = reader.read(fine.depth.row(i), fine.depth.row(i), scene, *next);
      alike += reading->top1 > 0, ++tried;
    }
    CHECK(alike < tried / 10);
  }
}
