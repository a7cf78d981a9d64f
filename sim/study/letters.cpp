// SPDX-License-Identifier: MIT
#include "sim/study/letters.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "acquire/record/letter.hpp"
#include "drivers/chart/chart.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/core/exit_code.hpp"
#include "sim/scene/draw.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/study/each_scene.hpp"

namespace echofuse::sim {
namespace {

using Rate = std::vector<double>;
constexpr std::array known_names{"brightness", "none"};
constexpr std::uint64_t noise_stream = 0x6c657474;  // "lett"

struct Point {
  std::string axis;
  double value;
  Conditions conditions;
};

std::vector<Point> points_of(const Conditions& base) {
  std::vector<Point> out{{"base", 0, base}};
  const auto vary = [&](const char* axis, double value, double Conditions::*key) {
    out.push_back({axis, value, base});
    out.back().conditions.*key = value;
  };
  for (const double fwhm : {2., 50., 200., 500., 1000.})
    vary("irf_ps", fwhm, &Conditions::irf_fwhm_ps);
  for (const double n : {1e2, 3e2, 1e3, 1e4, 1e5}) vary("photons", n, &Conditions::signal_photons);
  for (const double yaw : {0., 10., 20., 30.}) vary("yaw_deg", yaw, &Conditions::letter_yaw_deg);
  return out;
}

// The same scene with another letter of the same size on its plate.
Scene with_letter(Scene scene, char letter, const Conditions& c) {
  auto& strokes = scene.plates.back().strokes;
  const double scale = c.target_scale;
  const bool large = strokes.front().width_m > 0.06 * scale;
  strokes = record::letter_strokes(letter, record::letter_sizes[large ? 0 : 1].scaled(scale));
  return scene;
}

// What the detector expects of a letter: of the plate, and of all that is seen beside it.
struct Expected {
  Rate plate, body;
};

using ByLetter = std::array<Expected, 10>;

// Without background, by the same rays, so that they differ by the letter alone.
ByLetter expected_of(const Scene& scene, Conditions c) {
  c.background_counts = 0;
  ByLetter out;
  for (std::size_t k = 0; k < out.size(); ++k) {
    Scene one = with_letter(scene, record::letters[k], c);
    const Rate all = spd_rate(spd_returns(one, c), c);
    one.plates.back().albedo = 0;
    Rate& body = out[k].body = spd_rate(spd_returns(one, c), c);
    for (std::size_t i = 0; i < all.size(); ++i)
      out[k].plate.push_back(std::max(0.0, all[i] - body[i]));
  }
  return out;
}

void scale(ByLetter& expected, double by) {
  for (Expected& e : expected)
    for (Rate* rate : {&e.plate, &e.body})
      for (double& r : *rate) r *= by;
}

double log_likelihood(const std::vector<std::uint32_t>& counts, const Expected& e,
                      double background, bool brightness_known) {
  constexpr double least_rate = 1e-9;
  constexpr int most_steps = 60;
  double plate = 1, body = 1;
  const auto rate = [&](std::size_t i) {
    return std::max(least_rate, plate * e.plate[i] + body * e.body[i] + background);
  };
  // Expectation maximisation: each step is as likely as the one before it, or likelier.
  for (int step = 0; !brightness_known && step < most_steps; ++step) {
    double of_plate = 0, of_body = 0, plate_sum = 0, body_sum = 0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double share = counts[i] / rate(i);
      of_plate += share * e.plate[i], of_body += share * e.body[i];
      plate_sum += e.plate[i], body_sum += e.body[i];
    }
    plate *= of_plate / std::max(plate_sum, least_rate);
    body *= of_body / std::max(body_sum, least_rate);
  }
  double sum = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) sum += counts[i] * std::log(rate(i)) - rate(i);
  return sum;
}

struct Reading {
  std::size_t truth = 0, likeliest = 0,
              likelier = 0;  // letters that are likelier than the true one
};

// A row a point and knowledge, as study_letters'.
std::vector<Reading> read_scene(const std::vector<Point>& points, std::uint64_t seed,
                                std::uint64_t index) {
  std::vector<Reading> out;
  ByLetter of_base;
  for (const Point& p : points) {
    const Conditions& c = p.conditions;
    const Scene scene = make_scene(c, SceneKind::letter, seed, index);
    const std::size_t truth = record::letter_of(scene.label).value();
    // Another number of photons is the same scene, brighter; the rays are those of the base.
    ByLetter expected = p.axis == "photons" ? of_base : expected_of(scene, c);
    if (p.axis == "base") of_base = expected;
    if (p.axis == "photons")
      scale(expected, c.signal_photons / points.front().conditions.signal_photons);
    const double background = c.background_counts / static_cast<double>(c.bins);
    Rate rate(expected[truth].plate.size(), background);
    for (std::size_t i = 0; i < rate.size(); ++i)
      rate[i] += expected[truth].plate[i] + expected[truth].body[i];
    Rng rng = make_rng(mix(seed + noise_stream), index);
    const auto counts = draw_counts(rate, c, rng);
    for (const bool known : {true, false}) {
      std::array<double, 10> likelihood{};
      for (std::size_t k = 0; k < expected.size(); ++k)
        likelihood[k] = log_likelihood(counts, expected[k], background, known);
      const auto best = std::max_element(likelihood.begin(), likelihood.end());
      const auto better = std::count_if(likelihood.begin(), likelihood.end(),
                                        [&](double l) { return l > likelihood[truth]; });
      out.push_back({truth, static_cast<std::size_t>(best - likelihood.begin()),
                     static_cast<std::size_t>(better)});
    }
  }
  return out;
}

chart::Panel panel_of(const std::vector<LettersRow>& rows, const std::string& axis,
                      const std::string& title, bool log) {
  chart::Panel panel{
      "", {title, log}, {"share read rightly", false, 0, 1.05}, {}, {{0.1, "chance"}}};
  panel.width = 440;
  for (const char* known : known_names) {
    const bool brightness = known == std::string("brightness");
    chart::Series line{
        brightness ? "brightness known" : "unknown", {}, brightness ? chart::grey : chart::of_spd};
    for (const LettersRow& r : rows)
      if (r.axis == axis && r.known == known)
        line.points.push_back({r.value, r.top1, r.top1 - r.se, r.top1 + r.se});
    panel.series.push_back(line);
  }
  return panel;
}

}  // namespace

std::vector<LettersRow> study_letters(const LettersOptions& options) {
  if (options.conditions.pulses_per_window > 0)
    throw Error(ExitCode::config,
                "study letters: counts must be Poisson; leave out pulses_per_window");
  if (options.conditions.signal_photons <= 0)
    throw Error(ExitCode::config, "study letters: signal_photons is 0; expected some");
  const auto points = points_of(options.conditions);
  const auto found = each_scene<std::vector<Reading>>(
      "letters", options.scenes, options.quiet,
      [&](std::size_t i) { return read_scene(points, options.seed, i); });
  std::vector<LettersRow> rows;
  const auto scenes = static_cast<double>(found.size());
  for (const Point& p : points)
    for (const char* known : known_names) {
      LettersRow row{p.axis, p.value, known, 0, 0, 0, {}};
      for (const auto& scene : found) {
        const Reading& r = scene[rows.size()];
        row.top1 += (r.likelier == 0) / scenes, row.top3 += (r.likelier < 3) / scenes;
        ++row.confusion[r.truth][r.likeliest];
      }
      row.se = std::sqrt(std::max(0.0, row.top1 * (1 - row.top1)) / scenes);
      rows.push_back(row);
    }
  return rows;
}

void write_letters(const std::vector<LettersRow>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "axis,value,known,top1,top3,se\n";
  for (const LettersRow& r : rows)
    csv << r.axis << ',' << r.value << ',' << r.known << ',' << r.top1 << ',' << r.top3 << ','
        << r.se << '\n';
  chart::write_chart(
      folder, "letters", csv.str(),
      chart::stand_alone("Letters that the likelihood of a histogram tells, all else known",
                         {panel_of(rows, "photons", "photons a record", true),
                          panel_of(rows, "irf_ps", "response, FWHM (ps)", true),
                          panel_of(rows, "yaw_deg", "plates turn up to (degrees)", false)},
                         3));
}

std::string confusion_text(const LettersRow& row) {
  std::string out = "read as";
  char text[16];
  const auto add = [&](const char* format, auto value) {
    std::snprintf(text, sizeof text, format, value);
    out += text;
  };
  for (const char letter : record::letters) add("%4c", letter);
  for (std::size_t i = 0; i < row.confusion.size(); ++i) {
    add("\n%7c", record::letters[i]);
    for (const int count : row.confusion[i]) add("%4d", count);
  }
  return out + "\n";
}

}  // namespace echofuse::sim
