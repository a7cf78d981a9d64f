// SPDX-License-Identifier: MIT
// Flat letters that people hold, real and simulated. A record's label names its letter.
#pragma once
#include <array>
#include <cstddef>
#include <string_view>
#include <vector>

namespace echofuse::record {

inline constexpr std::string_view letters = "ACEHLNOTUX";
inline constexpr std::string_view letter_label = "letter:";  // followed by the letter

struct LetterSize {
  double width_m, height_m, stroke_m;
  LetterSize scaled(double by) const { return {by * width_m, by * height_m, by * stroke_m}; }
};
inline constexpr std::array<LetterSize, 2> letter_sizes{
    {{0.30, 0.40, 0.07}, {0.20, 0.30, 0.05}}};  // large, small

// Band of the given width around the segment (u0, v0)-(u1, v1) with square ends; u to the right, v
// up, metres.
struct Stroke {
  double u0 = 0, v0 = 0, u1 = 0, v1 = 0, width_m = 0;
};
// Returns the strokes of one of `letters`, centred.
std::vector<Stroke> letter_strokes(char letter, const LetterSize& size);

}  // namespace echofuse::record
