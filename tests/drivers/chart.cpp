// SPDX-License-Identifier: MIT
// What charts, pictures and pages have in common.
#include "drivers/chart/chart.hpp"

#include <array>
#include <catch2/catch.hpp>
#include <sstream>

#include "drivers/chart/colour_map.hpp"
#include "drivers/chart/labels.hpp"
#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"

using namespace echofuse::chart;

namespace {

double light_of(const std::string& hex) {
  const auto part = [&](std::size_t at) {
    const double c = std::stoi(hex.substr(at, 2), nullptr, 16) / 255.0;
    return c <= 0.03928 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  };
  return 0.2126 * part(1) + 0.7152 * part(3) + 0.0722 * part(5);
}

double contrast(const std::string& a, const std::string& b) {
  const double x = light_of(a), y = light_of(b);
  return (std::max(x, y) + 0.05) / (std::min(x, y) + 0.05);
}

// "--c0:#0b4a9e;" of the first set (light) or the second (dark).
std::string colour(const std::string& name, bool dark) {
  const std::string all = page_colours(), wanted = "--" + name + ":";
  auto at = all.find(wanted);
  if (dark) at = all.find(wanted, at + 1);
  REQUIRE(at != std::string::npos);
  return all.substr(at + wanted.size(), 7);
}

// L*a*b* of a colour as protanopes or deuteranopes see it (Machado, Oliveira and Fernandes 2009),
// or as it is.
std::array<double, 3> lab_of(const std::string& hex, int seen_by) {
  using Matrix = std::array<std::array<double, 3>, 3>;
  constexpr std::array<Matrix, 3> eyes{Matrix{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
                                       Matrix{{{0.152286, 1.052583, -0.204868},
                                               {0.114503, 0.786281, 0.099216},
                                               {-0.003882, -0.048116, 1.051998}}},
                                       Matrix{{{0.367322, 0.860646, -0.227968},
                                               {0.280085, 0.672501, 0.047413},
                                               {-0.011820, 0.042940, 0.968881}}}};
  constexpr Matrix xyz{
      {{0.4339, 0.3763, 0.1899}, {0.2126, 0.7152, 0.0722}, {0.0177, 0.1095, 0.8727}}};
  const auto times = [](const Matrix& m, const std::array<double, 3>& v) {
    std::array<double, 3> out{};
    for (std::size_t i = 0; i < 3; ++i)
      for (std::size_t k = 0; k < 3; ++k) out[i] += m[i][k] * v[k];
    return out;
  };
  std::array<double, 3> rgb{};
  for (std::size_t i = 0; i < 3; ++i) {
    const double c = std::stoi(hex.substr(1 + 2 * i, 2), nullptr, 16) / 255.0;
    rgb[i] = c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4);
  }
  auto seen = times(eyes[static_cast<std::size_t>(seen_by)], rgb);
  for (double& c : seen) c = std::clamp(c, 0.0, 1.0);
  auto f = times(xyz, seen);
  for (double& c : f) c = c > 0.008856 ? std::cbrt(c) : 7.787 * c + 16.0 / 116;
  return {116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])};
}

}  // namespace

TEST_CASE("any two colours of series are told apart, by the colour-blind too") {
  constexpr std::array<const char*, colour_count> names{"c0", "c1", "c2", "c3", "c4", "c5"};
  for (const bool dark : {false, true})
    for (int eyes = 0; eyes < 3; ++eyes)
      for (int i = 0; i < colour_count; ++i)
        for (int k = 0; k < i; ++k) {
          CAPTURE(dark, eyes, i, k);
          const auto a = lab_of(colour(names[static_cast<std::size_t>(i)], dark), eyes);
          const auto b = lab_of(colour(names[static_cast<std::size_t>(k)], dark), eyes);
          CHECK(std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]) > 15);
        }
}

TEST_CASE("texts and lines of charts and pages have the contrast that WCAG asks for") {
  for (const bool dark : {false, true})
    for (const std::string ground : {"paper", "back"}) {
      for (const char* name :
           {"c0", "c1", "c2", "c3", "c4", "c5", "ink", "quiet", "good", "look", "bad"})
        CHECK(contrast(colour(name, dark), colour(ground, dark)) >= 4.5);
      CHECK(contrast(colour("edge", dark), colour(ground, dark)) >= 2.8);
      for (const char* name : {"good-paper", "look-paper", "bad-paper"})
        CHECK(contrast(colour("ink", dark), colour(name, dark)) >= 7);
    }
}

TEST_CASE("ticks are round, within the span, and named in one unit") {
  CHECK(round_ticks(0, 1, false, 300) ==
        std::vector<double>{0, 0.2, 0.4, 0.6000000000000001, 0.8, 1});
  CHECK(round_ticks(-0.1, 0.55, false, 200).size() >= 3);
  CHECK(round_ticks(1, 1e6, true, 300) == std::vector<double>{1, 10, 100, 1000, 1e4, 1e5, 1e6});
  CHECK(round_ticks(8, 40, true, 300) == std::vector<double>{10, 20});
  CHECK(short_number(5000) == "5000");
  CHECK(short_number(5000, 20000) == "5 k");
  CHECK(short_number(1e6) == "1 M");
  CHECK(short_number(0.02) == "0.02");
}

TEST_CASE("names stand apart, in their order and as near as can be") {
  CHECK(spread_apart({10, 50}, 16, 0, 100) == std::vector<double>{10, 50});
  CHECK(spread_apart({50, 50, 50}, 16, 0, 100) == std::vector<double>{34, 50, 66});
  CHECK(spread_apart({98, 97}, 16, 0, 100) == std::vector<double>{100, 84});
  std::vector<Box> taken{{90, 90, 110, 110}};
  const Box area{0, 0, 300, 300};
  for (int i = 0; i < 6; ++i) place_label(100, 100, 60, area, taken);
  for (std::size_t i = 0; i < taken.size(); ++i)
    for (std::size_t k = 0; k < i; ++k) CHECK_FALSE(taken[i].meets(taken[k]));
}

TEST_CASE("a chart leaves out what is no number, and draws a point of one seed") {
  Panel panel{"A <title>",
              {"x", true},
              {"y"},
              {{"one & two",
                {{1, 1},
                 {0, 2},
                 {10, echofuse::chart::nan},
                 {100, 3, echofuse::chart::nan, echofuse::chart::nan}}}}};
  const std::string svg = draw(panel).svg;
  CHECK(svg.find("nan") == std::string::npos);
  CHECK(svg.find("inf") == std::string::npos);
  CHECK(svg.find("A &lt;title&gt;") != std::string::npos);
  CHECK(svg.find("one &amp; two") != std::string::npos);
  std::size_t circles = 0;
  for (auto at = svg.find("<circle"); at != std::string::npos; at = svg.find("<circle", at + 1))
    ++circles;
  CHECK(circles == 2);
  CHECK(draw(Panel{"", {"x"}, {"y"}, {}}).svg.find("nan") == std::string::npos);  // nothing at all
  CHECK(stand_alone("", std::vector<Panel>{panel, panel}, 2).find("var(--") == std::string::npos);
}

TEST_CASE("maps: near is bright, nothing is light") {
  const auto light = [](const Rgb& c) { return 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]; };
  double before = 256;
  for (int i = 0; i <= 20; ++i) {
    const double now = light(colour_of(ColourMap::near, i / 20.0));
    CHECK(now < before);
    before = now;
  }
  const std::vector<float> map{3, 0, 3.1F, 0};
  const Raster depth = depth_raster(map, 2, 2.5, 5);
  const auto pixel = [](const Raster& r, std::size_t i) {
    return Rgb{r.rgb[3 * i], r.rgb[3 * i + 1], r.rgb[3 * i + 2]};
  };
  CHECK(pixel(depth, 1) == no_return);
  CHECK(pixel(depth, 0) == colour_of(ColourMap::near, 0.2));
  std::vector<float> room(100, 0.F);
  CHECK(span_of(room).near == 2.5);
  for (std::size_t i = 0; i < 60; ++i) room[i] = 3.1F + static_cast<float>(i) / 100;
  CHECK(span_of(room).near == 3);
  CHECK(span_of(room).far == 4);
}

TEST_CASE("words below an axis are slanted where they would meet") {
  const auto with = [](const std::vector<std::string>& names) {
    Panel panel{"", {"room"}, {"IoU"}, {{"model", {}}}};
    for (std::size_t i = 0; i < names.size(); ++i) {
      panel.x.ticks.emplace_back(static_cast<double>(i), names[i]);
      panel.series[0].points.push_back({static_cast<double>(i), 0.5});
    }
    return draw(panel).svg;
  };
  const auto written = [](const std::string& svg, const std::string& name) {
    return svg.find(">" + name + "</text>") != std::string::npos;
  };
  std::vector<std::string> words, numbers;
  for (int i = 0; i < 9; ++i) {
    words.push_back("a corridor, RF " + std::to_string(i));
    numbers.push_back(std::to_string(1'234'567'890 + i));
  }
  const std::string slanted = with(words), thinned = with(numbers), level = with({"open", "room"});
  for (const std::string& word : words) CHECK(written(slanted, word));
  CHECK(slanted.find("rotate(-35)") != std::string::npos);
  CHECK_FALSE(std::all_of(numbers.begin(), numbers.end(),
                          [&](const std::string& n) { return written(thinned, n); }));
  for (const std::string& svg : {thinned, level})
    CHECK(svg.find("rotate(-35)") == std::string::npos);
}

TEST_CASE("a line has no markers, and a page has a chart in two widths") {
  Panel line{"", {"x"}, {"y"}, {{"", {{0, 0}, {1, 1}, {2, 2}}, 0, Look::line}}};
  CHECK(draw(line).svg.find("<circle") == std::string::npos);
  line.width = 560;
  const std::string widths = for_both_widths(line);
  CHECK(widths.find("wide-only") != std::string::npos);
  CHECK(widths.find("narrow-only") != std::string::npos);
  CHECK(wrapped("one two three", text_width("one two") + 1) ==
        std::vector<std::string>{"one two", "three"});
}

TEST_CASE("a page lists its sections, and leaves out empty ones") {
  Page page("a & b");
  page.section("one", "One", paragraph("<script>"));
  page.section("none", "None", "");
  page.section("two", "Two", table("", {"x"}, {{{"1"}}}));
  const std::string html = page.html();
  CHECK(html.find("href=\"#one\"") != std::string::npos);
  CHECK(html.find("None") == std::string::npos);
  CHECK(html.find("<script>") == std::string::npos);
  CHECK(html.find("<title>a &amp; b</title>") != std::string::npos);
}
