// SPDX-License-Identifier: MIT
// Which of the paper's ten letters a map shows in the place of the plate. What counts is the near
// layer of a map: what lies at the plate's depth or before it, not the body behind it. Resampled to
// cells of 2 cm it is correlated with templates of the letters, in windows as large as the plate
// and one cell more on each side, so that arms beside it matter little.
//
// Size and place of the plate are where the true map's near layer is most like the true letter. The
// ten letters of that size are then looked for in the map that is judged, up to 8 cm from there
// both ways; what counts is each one's best normalised correlation. The templates are blurred by
// one pixel of the map at 3 m. The near layer is 1 up to 15 cm behind the plate's middle and falls
// to 0 at 35 cm: a plate of 30 cm turned by 30 degrees at x = 1 m is 22 cm deep, and a person's
// chest is more than 38 cm behind it.
#pragma once
#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

#include "acquire/record/letter.hpp"
#include "recon/maps/scene.hpp"

namespace echofuse::recon {

using record::letter_of;
using record::letters;

class LetterReader {
 public:
  explicit LetterReader(const record::MapGrid& grid);
  // Made once for each grid, as that takes milliseconds; safe from any thread.
  static const LetterReader& of(const record::MapGrid& grid);
  // Where a letter is held, as the true map shows it.
  struct Plate {
    std::size_t letter, size;  // of record::letters, record::letter_sizes
    double x, y, depth_m;      // tangents of its middle
  };
  // None if the true map shows nothing.
  std::optional<Plate> find_plate(std::span<const float> truth, const Scene& scene,
                                  std::size_t letter) const;
  // Of a map that is judged, in the place of that plate.
  // 1 if its letter is the most alike; of a tie its share, as in a map without anything.
  double read(std::span<const float> map, const Scene& scene, const Plate& plate) const;

 private:
  // Of one letter and size: rows x columns cells, mean 0, sum of squares 1.
  struct Template {
    std::size_t columns, rows;
    std::vector<float> cells;
  };
  std::array<std::array<Template, letters.size()>, record::letter_sizes.size()>
      templates_;  // large, small
};

}  // namespace echofuse::recon
