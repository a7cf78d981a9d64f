// SPDX-License-Identifier: MIT
// Reading of the paper's ten letters from a map. The near layer of a map is what lies up to 20 cm
// behind the plate's middle or before it. In cells of 2 cm it is correlated with templates of the
// letters. Size and place of the plate are where the true map is most like the true letter. From
// there up to 8 cm both ways each letter's best normalised correlation counts.
#pragma once
#include <optional>
#include <span>

#include "acquire/measurement/letter.hpp"
#include "recon/metrics/scene.hpp"

namespace echofuse::recon {

using record::letter_of;
using record::letters;

// A plate says where a letter is held, by indices into record::letters and letter_sizes and by the
// tangents of its middle.
struct Plate {
  std::size_t letter, size;
  double x, y, depth_m;
};
// Returns nothing if the true map has no plate.
std::optional<Plate> find_plate(std::span<const float> truth, const Scene& scene,
                                std::size_t letter);
// Returns 1 if the letter itself correlates best at the plate's place, 0 if another one does; in a
// tie of k letters 1 / k, as in an empty map.
double read_letter(std::span<const float> map, const Scene& scene, const Plate& plate);

}  // namespace echofuse::recon
