// SPDX-License-Identifier: MIT
#include "sim/study/fidelity.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <sstream>

#include "drivers/program/new_file.hpp"
#include "drivers/program/program.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/render.hpp"
#include "sim/study/scene_rows.hpp"

namespace echofuse::sim {
namespace {

using Profile = std::vector<double>;

// The parts are in the order in which person.cpp makes them.
const std::vector<std::pair<std::string, std::vector<std::size_t>>> parts{
    {"thighs", {0, 3}}, {"shins", {1, 4}},        {"feet", {2, 5}},      {"pelvis", {6}},
    {"belly", {7}},     {"chest", {8}},           {"shoulders", {9}},    {"neck", {10}},
    {"head", {11}},     {"upper arms", {12, 14}}, {"forearms", {13, 15}}};

Scene without(Scene scene, const std::vector<std::size_t>& capsules) {
  for (auto i = capsules.rbegin(); i != capsules.rend(); ++i)
    scene.capsules.erase(scene.capsules.begin() + static_cast<std::ptrdiff_t>(*i));
  return scene;
}

using Model = std::function<Profile(const Scene&)>;

struct Candidate {
  std::string value;
  Model model;
  bool timed = true;
};

// Comparison of approximations with one finer reference. `variance` gives the variance of the noise
// from the fine profile's value; with 0 the bin does not count.
struct Comparison {
  std::string axis;
  Model fine;
  std::vector<Candidate> candidates;
  std::function<double(double)> variance;
};

double shot_noise(double counts) { return counts >= 1 ? counts : 0; }

Conditions with_rays(Conditions c, std::int64_t count) {
  c.spd_rays = count;
  return c;
}

Model histogram(const Conditions& c) {
  return [c](const Scene& scene) { return spd_rate(spd_returns(scene, c), c); };
}

Comparison rays(const Conditions& c) {
  std::vector<Candidate> all;
  for (const int n : {48, 64, 96, 128, 192, 256, 320, 384, 512, 768})
    all.push_back({std::to_string(n), histogram(with_rays(c, n))});
  return {"rays", histogram(with_rays(c, 2048)), all, shot_noise};
}

Comparison body(const Conditions& c) {
  const Model whole = histogram(with_rays(c, 1024));
  std::vector<Candidate> all;
  for (const auto& [name, capsules] : parts)
    all.push_back(
        {name,
         [whole, which = capsules](const Scene& scene) { return whole(without(scene, which)); },
         false});
  return {"part", whole, all, shot_noise};
}

Comparison bin_width(const Conditions& base, std::int64_t width) {
  Conditions coarse = with_rays(base, 1024);
  coarse.bin_width_ps = static_cast<double>(width);
  const double span_ps = static_cast<double>(base.bins) * base.bin_width_ps;
  coarse.bins = std::max<std::int64_t>(1, std::lround(span_ps / coarse.bin_width_ps));
  Conditions fine = coarse;
  fine.bin_width_ps /= 4;
  fine.bins *= 4;
  const Model model = histogram(coarse);
  const Model spread = [model](const Scene& scene) {
    Profile out;
    for (const double counts : model(scene)) out.insert(out.end(), 4, counts / 4);
    return out;
  };
  return {"bin_ps", histogram(fine), {{std::to_string(width), spread, false}}, shot_noise};
}

Comparison radar(const Conditions& c, double sigma) {
  const RadarAxis axis = radar_response(c);
  const auto profile = [&](std::int64_t count) -> Model {
    Conditions changed = c;
    changed.radar_rays = count;
    return [changed, axis](const Scene& scene) {
      return radar_power(radar_returns(scene, changed), axis);
    };
  };
  std::vector<Candidate> all;
  for (const int n : {48, 96, 192, 288, 384, 576, 768})
    all.push_back({std::to_string(n), profile(n)});
  return {"radar_rays", profile(1536), all, [sigma](double) { return sigma * sigma; }};
}

std::vector<Comparison> comparisons(const Conditions& c) {
  std::vector<Comparison> out = {rays(c), body(c)};
  for (const std::int64_t width : {25, 50, 100, 200, 400, 800}) out.push_back(bin_width(c, width));
  const double sigma = profile_noise(c, mean_peak_power(radar_response(c), c), c.radar_frames);
  out.push_back(radar(c, sigma));
  return out;
}

double error_of(const Profile& seen, const Profile& truth, const Comparison& how) {
  double sum = 0, bins = 0;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    const double v = how.variance(truth[k]);
    if (v <= 0) continue;
    sum += (seen[k] - truth[k]) * (seen[k] - truth[k]) / v;
    ++bins;
  }
  return bins > 0 ? sum / bins : 0;
}

// Returns the errors of every candidate, in the order of the comparisons.
SceneRow errors_of(const Scene& scene, const std::vector<Comparison>& all) {
  SceneRow out;
  for (const Comparison& how : all) {
    const Profile truth = how.fine(scene);
    for (const Candidate& candidate : how.candidates)
      out.push_back(error_of(candidate.model(scene), truth, how));
  }
  return out;
}

// Microseconds of processor time a scene, measured one after the other, because nothing else may
// run beside it.
double time_of(const Candidate& candidate, const std::vector<Scene>& scenes) {
  candidate.model(scenes.front());  // the first call is slower
  const std::clock_t begin = std::clock();
  for (const Scene& scene : scenes) candidate.model(scene);
  return 1e6 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC /
         static_cast<double>(scenes.size());
}

Fidelity row_of(const std::string& axis, const Candidate& candidate,
                const std::vector<SceneRow>& found, std::size_t column) {
  const auto n = static_cast<double>(found.size());
  double mean = 0, squares = 0;
  for (const SceneRow& scene : found) mean += scene[column] / n;
  for (const SceneRow& scene : found) squares += (scene[column] - mean) * (scene[column] - mean);
  return {axis, candidate.value, mean, n > 1 ? std::sqrt(squares / (n - 1) / n) : 0, 0};
}

}  // namespace

std::vector<Fidelity> study_fidelity(const FidelityOptions& options) {
  std::vector<Scene> scenes;
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(options.scenes); ++i)
    scenes.push_back(make_scene(options.conditions, study_kind(i), options.seed, i));
  const auto all = comparisons(options.conditions);
  const auto found = rows_of_scenes("fidelity", options.scenes, options.quiet,
                                    [&](std::size_t i) { return errors_of(scenes[i], all); });
  std::vector<Fidelity> rows;
  for (const Comparison& how : all)
    for (const Candidate& candidate : how.candidates) {
      rows.push_back(row_of(how.axis, candidate, found, rows.size()));
      if (candidate.timed) rows.back().us = time_of(candidate, scenes);
    }
  return rows;
}

void write_fidelity(const std::vector<Fidelity>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "axis,value,error_over_noise_variance,standard_error,us,machine\n";
  for (const Fidelity& r : rows)
    csv << r.axis << ',' << r.value << ',' << r.error << ',' << r.standard_error << ',' << r.us
        << ',' << (r.us > 0 ? machine_name() : "") << '\n';
  write_atomically(folder + "/fidelity.csv", csv.str());
}

}  // namespace echofuse::sim
