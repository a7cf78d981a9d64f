// SPDX-License-Identifier: MIT
// Which letter a histogram tells at best: the likelihood of the counts under each of the ten
// letters, all of them held by the same person in the same place. An estimator that has to find
// person, place and turn as well reads fewer.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "sim/scene/conditions.hpp"

namespace echofuse::sim {

// What is known of a scene beside person, pose, place, turn and the letter's size.
enum class KnownLight : std::uint8_t {
  brightness,  // gain and reflectivities, too: the ink's area tells
  none,  // the brightness of plate and body are fitted to the counts: what remains is their profile
};

struct LettersRow {
  std::string axis;                                 // base, irf_ps, photons, yaw_deg
  double value = 0;                                 // 0 for base
  std::string known;                                // brightness, none
  double top1 = 0, top3 = 0;                        // shares of the scenes
  double se = 0;                                    // of top1
  std::array<std::array<int, 10>, 10> confusion{};  // scenes by true and by likeliest letter
};

struct LettersOptions {
  Conditions conditions;
  std::int64_t scenes = 300;
  std::uint64_t seed = 1;
  bool quiet = false;
};

// Throws Error(config) for counts that are none or not Poisson (pile-up), and Error(interrupted).
std::vector<LettersRow> study_letters(const LettersOptions& options);

// letters.csv and letters.svg in `folder`, which exists. Throws Error(disk).
void write_letters(const std::vector<LettersRow>& rows, const std::string& folder);

// The confusion matrix as lines of text.
std::string confusion_text(const LettersRow& row);

}  // namespace echofuse::sim
