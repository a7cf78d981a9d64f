// SPDX-License-Identifier: MIT
// Shapes of the flat letters that people hold in real and simulated recordings. The label of a
// record contains its letter.
#pragma once
#include <array>
#include <string_view>
#include <vector>

namespace echofuse::record {

inline constexpr std::string_view letters = "ACEHLNOTUX";
// Text that precedes the letter in a record's label.
inline constexpr std::string_view letter_label = "letter:";

struct LetterSize {
  double width_m, height_m, stroke_m;
  LetterSize scaled(double by) const { return {by * width_m, by * height_m, by * stroke_m}; }
};
inline constexpr std::array<LetterSize, 2> letter_sizes{{{0.30, 0.40, 0.07}, {0.20, 0.30, 0.05}}};

// Straight stroke with square ends from (u0, v0) to (u1, v1). Coordinates are in metres; u points
// to the right and v up.
struct Stroke {
  double u0 = 0, v0 = 0, u1 = 0, v1 = 0, width_m = 0;
};
// Returns the strokes of a letter from `letters`, centred on the origin.
std::vector<Stroke> letter_strokes(char letter, const LetterSize& size);

}  // namespace echofuse::record
