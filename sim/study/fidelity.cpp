// SPDX-License-Identifier: MIT
#include "sim/study/fidelity.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <functional>
#include <sstream>

#include "drivers/chart/chart.hpp"
#include "drivers/core/console.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/sensors/render.hpp"

namespace echofuse::sim {
namespace {

using Profile = std::vector<double>;

// In the order in which person.cpp makes them.
const std::vector<std::pair<std::string, std::vector<std::size_t>>> parts{
    {"thighs", {0, 3}}, {"shins", {1, 4}},        {"feet", {2, 5}},      {"pelvis", {6}},
    {"belly", {7}},     {"chest", {8}},           {"shoulders", {9}},    {"neck", {10}},
    {"head", {11}},     {"upper arms", {12, 14}}, {"forearms", {13, 15}}};

Scene without(Scene scene, const std::vector<std::size_t>& capsules) {
  for (auto i = capsules.rbegin(); i != capsules.rend(); ++i)
    scene.capsules.erase(scene.capsules.begin() + static_cast<std::ptrdiff_t>(*i));
  return scene;
}

class Study {
 public:
  explicit Study(const FidelityOptions& o)
      : options_(o), progress_("fidelity", 4 * static_cast<std::size_t>(o.scenes), o.quiet) {
    for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(o.scenes); ++i)
      scenes_.push_back(make_scene(o.conditions, study_kind(i), o.seed, i));
  }

  std::vector<Fidelity> run() {
    rays();
    body();
    bin_widths();
    radar();
    return std::move(rows_);
  }

 private:
  using Model = std::function<Profile(const Scene&)>;
  struct Candidate {
    std::string value;
    Model model;
    bool timed = true;
  };

  // `variance`: of the noise, from the fine profile's value; 0: the bin does not count.
  void compare(const std::string& axis, const Model& fine, const std::vector<Candidate>& candidates,
               const std::function<double(double)>& variance) {
    std::vector<std::vector<double>> errors(candidates.size());
    std::vector<double> used(candidates.size());
    for (const Scene& scene : scenes_) {
      const Profile truth = fine(scene);
      for (std::size_t c = 0; c < candidates.size(); ++c) {
        const std::clock_t begin = std::clock();
        const Profile seen = candidates[c].model(scene);
        used[c] += 1e6 * static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC;
        double sum = 0, bins = 0;
        for (std::size_t k = 0; k < truth.size(); ++k) {
          const double v = variance(truth[k]);
          if (v <= 0) continue;
          sum += (seen[k] - truth[k]) * (seen[k] - truth[k]) / v;
          ++bins;
        }
        errors[c].push_back(bins > 0 ? sum / bins : 0);
      }
      progress_.update(++done_);
    }
    const auto n = static_cast<double>(scenes_.size());
    for (std::size_t c = 0; c < candidates.size(); ++c) {
      double mean = 0, squares = 0;
      for (const double e : errors[c]) mean += e / n;
      for (const double e : errors[c]) squares += (e - mean) * (e - mean);
      rows_.push_back({axis, candidates[c].value, mean,
                       n > 1 ? std::sqrt(squares / (n - 1) / n) : 0,
                       candidates[c].timed ? used[c] / n : 0});
    }
  }

  static double shot_noise(double counts) { return counts >= 1 ? counts : 0; }
  Conditions with_rays(std::int64_t count) const {
    Conditions c = options_.conditions;
    c.spd_rays = count;
    return c;
  }
  static Model histogram(const Conditions& c) {
    return [c](const Scene& scene) { return spd_rate(spd_returns(scene, c), c); };
  }

  void rays() {
    std::vector<Candidate> all;
    for (const int n : {48, 64, 96, 128, 192, 256, 320, 384, 512, 768})
      all.push_back({std::to_string(n), histogram(with_rays(n))});
    compare("rays", histogram(with_rays(2048)), all, shot_noise);
  }

  void body() {
    const Model whole = histogram(with_rays(1024));
    std::vector<Candidate> all;
    for (const auto& [name, capsules] : parts)
      all.push_back(
          {name,
           [&whole, which = capsules](const Scene& scene) { return whole(without(scene, which)); },
           false});
    compare("part", whole, all, shot_noise);
  }

  void bin_widths() {
    constexpr std::int64_t finest = 25;
    for (const std::int64_t width : {25, 50, 100, 200, 400, 800}) {
      Conditions coarse = with_rays(1024);
      coarse.bin_width_ps = static_cast<double>(width);
      coarse.bins = std::max<std::int64_t>(
          1, static_cast<std::int64_t>(std::lround(static_cast<double>(options_.conditions.bins) *
                                                   options_.conditions.bin_width_ps /
                                                   coarse.bin_width_ps)));
      Conditions fine = coarse;
      fine.bin_width_ps /= 4;
      fine.bins *= 4;
      const Model model = histogram(coarse);
      const Model spread = [model](const Scene& scene) {
        Profile out;
        for (const double counts : model(scene)) out.insert(out.end(), 4, counts / 4);
        return out;
      };
      const bool first = width == finest;
      const auto done = done_;
      compare("bin_ps", histogram(fine), {{std::to_string(width), spread, false}}, shot_noise);
      if (!first) done_ = done;  // one step of the bar for all widths
    }
  }

  void radar() {
    const Conditions& c = options_.conditions;
    const RadarAxis axis = radar_response(c);
    const double sigma = radar_noise_power(c, mean_peak_power(axis, c));
    const auto profile = [&](std::int64_t count) -> Model {
      Conditions changed = c;
      changed.radar_rays = count;
      return [changed, axis](const Scene& scene) {
        return radar_power(radar_returns(scene, changed), axis, changed);
      };
    };
    std::vector<Candidate> all;
    for (const int n : {48, 96, 192, 288, 384, 576, 768})
      all.push_back({std::to_string(n), profile(n)});
    compare("radar_rays", profile(1536), all, [&](double) { return sigma * sigma; });
  }

  const FidelityOptions& options_;
  Progress progress_;
  std::size_t done_ = 0;
  std::vector<Scene> scenes_;
  std::vector<Fidelity> rows_;
};

constexpr double enough = 0.1;  // of the noise's variance

chart::Panel panel_of(const std::vector<Fidelity>& rows, const std::string& axis,
                      const std::string& title, const std::string& x, const std::string& noise) {
  chart::Panel panel{title, {x, true}, {"error / " + noise + " variance", true}, {{"", {}}}};
  panel.rules = {{enough, "a tenth"}};
  panel.width = 500;
  for (const Fidelity& r : rows)
    if (r.axis == axis)
      panel.series[0].points.push_back({r.us > 0 ? r.us : std::stod(r.value), r.error, chart::nan,
                                        chart::nan, r.us > 0 ? r.value : ""});
  return panel;
}

// A row a part, those that matter most on top.
chart::Panel parts_panel(const std::vector<Fidelity>& rows) {
  chart::Panel panel{"Parts of the body, left out",
                     {"error / shot-noise variance", true},
                     {""},
                     {{"", {}, 0, chart::Look::markers}}};
  std::vector<Fidelity> shown;
  for (const Fidelity& r : rows)
    if (r.axis == "part") shown.push_back(r);
  std::sort(shown.begin(), shown.end(),
            [](const auto& a, const auto& b) { return a.error < b.error; });
  for (const Fidelity& r : shown) {
    const auto y = static_cast<double>(panel.y.ticks.size());
    panel.y.ticks.emplace_back(y, r.value);
    panel.series[0].points.push_back({r.error, y});
  }
  panel.rules = {{enough, "a tenth", true}};
  panel.width = 500;
  return panel;
}

}  // namespace

std::vector<Fidelity> study_fidelity(const FidelityOptions& options) {
  return Study(options).run();
}

void write_fidelity(const std::vector<Fidelity>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "axis,value,error_over_noise_variance,standard_error,us\n";
  for (const Fidelity& r : rows)
    csv << r.axis << ',' << r.value << ',' << r.error << ',' << r.standard_error << ',' << r.us
        << '\n';
  const std::string time = "processor time of one scene (\u00b5s)";
  chart::write_chart(
      folder, "fidelity", csv.str(),
      chart::stand_alone(
          "What an approximation costs, and what it errs",
          {panel_of(rows, "rays", "Rays of the detector", time, "shot-noise"),
           panel_of(rows, "radar_rays", "Rays of the radar", time, "noise"),
           panel_of(rows, "bin_ps", "Structure finer than the bin", "bin width (ps)", "shot-noise"),
           parts_panel(rows)},
          2));
}

}  // namespace echofuse::sim
