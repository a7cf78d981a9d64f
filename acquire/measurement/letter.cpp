// SPDX-License-Identifier: MIT
#include "acquire/measurement/letter.hpp"

namespace echofuse::record {

std::vector<Stroke> letter_strokes(char letter, const LetterSize& size) {
  const double w = size.stroke_m, right = size.width_m / 2, top = size.height_m / 2;
  const double a = right - w / 2, b = top - w / 2;  // centre lines of the outer strokes
  const Stroke left_post{-a, -top, -a, top, w}, right_post{a, -top, a, top, w};
  const Stroke roof{-right, b, right, b, w}, base{-right, -b, right, -b, w};
  const Stroke bar{-right, 0, right, 0, w};
  switch (letter) {
    case 'A': {
      const double v = -top / 3, u = a * (top - v) / (2 * top);
      return {{-a, -top, 0, top, w}, {0, top, a, -top, w}, {-u, v, u, v, w}};
    }
    case 'C':
      return {left_post, roof, base};
    case 'E':
      return {left_post, roof, bar, base};
    case 'H':
      return {left_post, right_post, bar};
    case 'L':
      return {left_post, base};
    case 'N':
      return {left_post, right_post, {-a, top, a, -top, w}};
    case 'O':
      return {left_post, right_post, roof, base};
    case 'T':
      return {roof, {0, -top, 0, top, w}};
    case 'U':
      return {left_post, right_post, base};
    default:
      return {{-a, -top, a, top, w}, {-a, top, a, -top, w}};  // X
  }
}

}  // namespace echofuse::record
