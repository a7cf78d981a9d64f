// SPDX-License-Identifier: MIT
// What all charts, pictures and pages have in common: one font, six colours, light and dark.
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "drivers/core/bytes.hpp"

namespace echofuse::chart {

// Series have colours 0 to 4; grey is for what they are compared with. Each colour has a marker of
// its own, so that they can be told without colours too. Contrast to the paper is 4.5 and more;
// protanopes and deuteranopes can tell any two. In all charts a colour means the same, if it can:
// a sensor (or what is made of it alone), what is made of both, or the paper's network.
inline constexpr int of_spd = 0, of_radar = 1, of_camera = 2, of_both = 3, of_paper = 4, grey = 5,
                     colour_count = 6;

inline constexpr double font_px = 13;
// How wide a text is drawn, about: of a common sans-serif font.
double text_width(std::string_view text, double px = font_px);

// For XML and HTML; what cannot be printed is written as escapes.
std::string escaped(std::string_view text);
// Lines of at most this width, broken at spaces.
std::vector<std::string> wrapped(const std::string& text, double width_px);
std::string base64(ByteView bytes);
std::string data_uri(const char* type, ByteView bytes);
// A number of a drawing: two decimals at most.
std::string number(double value);

// Rules for the classes that drawings use. `variables`: by the colours of a page (page_colours),
// which has a dark side; else with the light colours themselves, for files that stand alone.
std::string drawing_style(bool variables);
// The custom properties of a page, light and dark.
std::string page_colours();

}  // namespace echofuse::chart
