// SPDX-License-Identifier: MIT
#include "sim/study/bound.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <sstream>

#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "sim/scene/draw.hpp"
#include "sim/scene/shapes.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/radar_echo.hpp"
#include "sim/study/scene_rows.hpp"

namespace echofuse::sim {

Matrix slopes(const Model& model, const Values& at, double step) {
  Matrix out;
  for (std::size_t p = 0; p < at.size(); ++p) {
    Values moved = at;
    moved[p] = at[p] + step;
    Values above = model(moved);
    moved[p] = at[p] - step;
    const Values below = model(moved);
    for (std::size_t i = 0; i < above.size(); ++i) above[i] = (above[i] - below[i]) / (2 * step);
    out.push_back(std::move(above));
  }
  return out;
}

Matrix information(const Matrix& rows, std::size_t first, std::size_t count) {
  Matrix out(rows.size(), Values(rows.size()));
  for (std::size_t p = 0; p < rows.size(); ++p)
    for (std::size_t q = 0; q < rows.size(); ++q) {
      const double* a = rows[p].data() + first;
      out[p][q] = std::inner_product(a, a + count, rows[q].data() + first, 0.0);
    }
  return out;
}

// Cholesky gives M = L L^T; then g^T M^-1 g = |L^-1 g|^2. Parameters are in units of their own
// deviation: their scales must not decide what counts as singular.
double least_deviation(const Matrix& m, const Values& gradient) {
  const std::size_t n = m.size();
  constexpr double singular = 1e-13;
  Matrix l(n, Values(n));
  double sum = 0;
  Values solved(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double unit = std::sqrt(m[i][i]);
    if (!(unit > 0)) return std::numeric_limits<double>::infinity();
    for (std::size_t j = 0; j <= i; ++j) {
      double rest = m[i][j] / unit / std::sqrt(m[j][j]);
      for (std::size_t k = 0; k < j; ++k) rest -= l[i][k] * l[j][k];
      if (i == j && rest < singular) return std::numeric_limits<double>::infinity();
      l[i][j] = i == j ? std::sqrt(rest) : rest / l[j][j];
    }
    double rest = gradient[i] / unit;
    for (std::size_t k = 0; k < i; ++k) rest -= l[i][k] * solved[k];
    solved[i] = rest / l[i][i];
    sum += solved[i] * solved[i];
  }
  return std::sqrt(sum);
}

namespace {

Interval clipped(Interval t, double half) {
  return {std::clamp(t.low, -half, half), std::clamp(t.high, -half, half)};
}

// Returns where all that moves can be met, or the whole field of view if something stands behind
// it.
std::pair<Interval, Interval> window(const Scene& scene, Vec3 sensor, double half_x,
                                     double half_y) {
  const Interval all_x{-half_x, half_x}, all_y{-half_y, half_y};
  if (scene.room) return {all_x, all_y};
  Interval x{INFINITY, -INFINITY}, y = x;
  const auto add = [&](const auto& shape) {
    x = hull(x, shape.tangents_x());
    y = hull(y, shape.tangents_y());
  };
  for (const auto& c : scene.capsules) add(CapsuleShape(c, sensor));
  for (const auto& p : scene.plates) add(PlateShape(p, sensor));
  return {clipped(x, half_x), clipped(y, half_y)};
}

Axis rays_over(Interval t, std::int64_t rays) {
  const double step = (t.high - t.low) / static_cast<double>(rays);
  return {"", "tangent", "1", static_cast<std::uint32_t>(rays), t.low + step / 2, step};
}

Seen see(const Scene& scene, double sensor_x_m, double half_x, double half_y, double extra_m,
         std::int64_t rays) {
  const auto [tx, ty] = window(scene, {sensor_x_m, 0, 0}, half_x, half_y);
  const Axis x = rays_over(tx, rays), y = rays_over(ty, rays);
  const double pixel = x.step * y.step / mean_scene_weight;
  const auto hits = cast(scene, sensor_x_m, x, y, Sampling::staggered);
  Seen out;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    const double range = hits[i].range_m, z = hits[i].z_m;
    if (range <= 0) continue;
    const double along = z / range;
    out.range_m.push_back(range + extra_m);
    out.weight.push_back(pixel * along * along * along * hits[i].albedo * hits[i].cos_theta /
                         (range * range));
    const double right = x.at(static_cast<double>(i % x.count));
    out.cosine_x.push_back(right * along);
    out.cosine_z.push_back(along);
    out.tangent += right;
    out.z_m += z;
  }
  const auto n = static_cast<double>(std::max<std::size_t>(1, out.range_m.size()));
  out.tangent /= n;
  out.z_m /= n;
  return out;
}

// Point of the study's axes, and the place of its measurements in the row of all.
struct Point {
  std::string axis;
  double value;
  Conditions conditions;
  std::size_t spd = 0, radar = 0;  // first columns
  double radar_sigma = 0;
};

// Computes 2 sqrt(counts) for every number of photons, the profile of every radar, and last the
// silhouette's place, as a function of the scene's random numbers and of both gains.
class Laboratory {
 public:
  explicit Laboratory(const BoundOptions& o) : rays_(o.rays), base_(o.conditions) {
    add("base", 0, base_);
    for (const double snr : {10, 15, 20, 25, 30}) vary("snr_db", snr, &Conditions::radar_snr_db);
    for (const double n : {1e2, 1e3, 1e4, 1e5, 1e6})
      vary("photons", n, &Conditions::signal_photons);
    for (const double b : {0.1, 0.25, 0.5, 1.0, 2.0})
      vary("baseline_m", b, &Conditions::baseline_m);
    for (const double r : {0.05, 0.1, 0.25, 0.5, 1.0}) {
      Conditions c = base_;
      c.radar_step_m *= r / c.radar_resolution_m;
      c.radar_bins = 1 + std::lround(static_cast<double>(base_.radar_bins - 1) *
                                     base_.radar_step_m / c.radar_step_m);
      c.radar_resolution_m = r;
      add("resolution_m", r, c);
    }
    lay_out();
  }

  const std::vector<Point>& points() const { return points_; }
  std::size_t bins() const { return static_cast<std::size_t>(base_.bins); }
  std::size_t radar_begin() const { return points_.front().radar; }  // the SPD's columns come first

  // `z_m` is the true distance, at which angles become metres.
  Values measure(const Scene& scene, double spd_gain, double radar_gain, double z_m) const {
    Values out;
    const Seen spd = seen_by_spd(scene, base_, rays_);
    add_counts(out, spd, spd_gain);
    Seen radar;
    double baseline = -1;
    for (const Point& p : points_) {
      if (p.radar != out.size()) continue;  // another point has the same radar
      if (p.conditions.baseline_m != baseline) radar = seen_by_radar(scene, p.conditions, rays_);
      baseline = p.conditions.baseline_m;
      for (const double power : radar_power(radar, radar_response(p.conditions)))
        out.push_back(radar_gain * power);
    }
    out.push_back(spd.tangent * z_m);
    return out;
  }

 private:
  void add(const std::string& axis, double value, const Conditions& c) {
    const double peak = mean_peak_power(radar_response(c), c);
    points_.push_back({axis, value, c, 0, 0, profile_noise(c, peak, c.radar_frames)});
  }
  void vary(const std::string& axis, double value, double Conditions::*key) {
    Conditions c = base_;
    c.*key = value;
    add(axis, value, c);
  }

  // Histograms come first, then profiles; each is there once.
  void lay_out() {
    std::size_t column = 0;
    for (Point& p : points_) {
      p.spd = 0;
      if (p.axis != "base" && p.axis != "photons") continue;
      p.spd = column;
      column += bins();
    }
    for (Point& p : points_) {
      p.radar = points_.front().radar;
      if (p.axis != "base" && p.axis != "baseline_m" && p.axis != "resolution_m") continue;
      p.radar = column;
      column += static_cast<std::size_t>(p.conditions.radar_bins);
    }
  }

  void add_counts(Values& out, const Seen& spd, double gain) const {
    const auto rate = spd_rate(spd, base_);
    const double background = base_.background_counts / static_cast<double>(base_.bins);
    for (const Point& p : points_) {
      if (p.spd != out.size()) continue;  // another point has the same photons
      const double scale = gain * p.conditions.signal_photons / base_.signal_photons;
      for (const double r : rate)
        out.push_back(2 * std::sqrt(background + scale * std::max(0.0, r - background)));
    }
  }

  std::int64_t rays_;
  Conditions base_;
  std::vector<Point> points_;
};

constexpr std::array known_names{"shape", "pose"};

// Bounds of one scene, one row for each point and knowledge, as in study_bound.
class SceneBounds {
 public:
  SceneBounds(const Laboratory& laboratory, const BoundOptions& options, SceneSpec spec,
              std::uint64_t index)
      : laboratory_(laboratory) {
    const Rng rng = make_rng(options.seed, index);
    SceneSampler sampler(rng);
    const Scene truth = make_scene(options.conditions, spec, sampler);
    for (const auto& [low, high, value] : sampler.draws()) {
      if (high > low) drawn_.push_back(ranges_.size());
      ranges_.push_back(high - low);
    }
    const double z = seen_by_spd(truth, options.conditions, options.rays).z_m;
    const auto model = [&](const Values& at) {
      if (interrupted())  // a scene takes seconds
        throw Error(ExitCode::interrupted, "interrupted; nothing was written");
      Values moves(ranges_.size());
      for (std::size_t i = 0; i < drawn_.size(); ++i) moves[drawn_[i]] = at[i] * ranges_[drawn_[i]];
      SceneSampler moved(rng, moves);
      return laboratory.measure(make_scene(options.conditions, spec, moved), 1 + at[drawn_.size()],
                                1 + at[drawn_.size() + 1], z);
    };
    slopes_ = slopes(model, Values(drawn_.size() + 2), options.step);
    if (!truth.room && drawn_[2] == 2)
      keep_symmetry(sampler.draws(), spec.kind == SceneKind::letter);
  }

  // Deviations of x and of the centroid, for each point and knowledge.
  SceneRow all() const {
    SceneRow out;
    for (const Point& p : laboratory_.points())
      for (const Known known : {Known::shape, Known::pose})
        for (const double deviation : at(p, known)) out.push_back(deviation);
    return out;
  }

 private:
  // A scene turned about the detector's vertical axis gives the same histogram. So one of its
  // slopes along x, along z and with the turn (which for a letter is counted from the line of
  // sight) is redundant. The range is known so much better than the azimuth that a per cent of
  // numerical error in the slope along x would pass for knowledge of it. Therefore that slope is
  // computed from the other two. (Bodies that stick out of the field of view could tell a little.)
  void keep_symmetry(const std::vector<SceneSampler::Draw>& draws, bool letter) {
    const double x = draws[0].value, z = draws[1].value,
                 radian = letter ? 0 : 180 / std::numbers::pi;
    for (std::size_t i = 0; i < laboratory_.radar_begin(); ++i)
      slopes_[0][i] =
          ranges_[0] / z * (x / ranges_[1] * slopes_[1][i] + radian / ranges_[2] * slopes_[2][i]);
  }

  std::array<double, 2> at(const Point& p, Known known) const {
    Matrix rows;
    Values x, lateral;
    for (std::size_t i = 0; i < slopes_.size(); ++i) {
      const bool gain = i >= drawn_.size();
      if (known == Known::shape && !gain && drawn_[i] >= 3) continue;  // x, z, turn come first
      x.push_back(!gain && drawn_[i] == 0 ? ranges_[0] : 0);
      lateral.push_back(slopes_[i].back());
      rows.push_back(slopes_[i]);
    }
    Matrix m = information(rows, p.spd, laboratory_.bins());
    const auto radar =
        information(rows, p.radar, static_cast<std::size_t>(p.conditions.radar_bins));
    for (std::size_t i = 0; i < m.size(); ++i) {
      for (std::size_t j = 0; j < m.size(); ++j)
        m[i][j] += radar[i][j] / (p.radar_sigma * p.radar_sigma);
      // The prior is that of a uniform range of 1.
      if (known == Known::pose && i < drawn_.size()) m[i][i] += 12;
    }
    return {least_deviation(m, x), least_deviation(m, lateral)};
  }

  const Laboratory& laboratory_;
  std::vector<std::size_t> drawn_;  // the random numbers that are not constant
  Values ranges_;                   // ranges of all of them
  Matrix slopes_;                   // slopes of drawn_, then of both gains
};

void check(const Conditions& c) {
  const auto refuse = [](const std::string& why) {
    throw Error(ExitCode::config, "study bound: " + why);
  };
  if (c.pulses_per_window > 0) refuse("counts must be Poisson; leave out pulses_per_window");
  if (c.radar_sum != "incoherent") refuse("speckle is not Gaussian; radar_sum must be incoherent");
  if (c.multipath_order > 0 || c.radar_wall_scatter != 1)
    refuse("it knows no multipath_order and radar_wall_scatter");
  if (c.signal_photons <= 0) refuse("signal_photons is 0; expected some");
  if (c.baseline_error_m != 0 || c.spd_falloff > 0 || c.radar_falloff > 0 || c.spd_yaw_deg != 0 ||
      c.slot_sway_m > 0 || c.radar_lobe != 1 || c.radar_plate_lobe != 1 || c.optical_lobe != 1 ||
      c.spd_field != 1)
    refuse("it knows no baseline_error_m, falloff, spd_field, yaw, slot_sway_m and lobes");
  if (c.target_x_m <= 0) refuse("target_x_m is 0: the lateral position is known");
}

double quantile(std::vector<double> values, double share) {
  const auto k = static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(k), values.end());
  return values[k];
}

Bound summary(const Point& p, const char* known, const std::vector<SceneRow>& found,
              std::size_t row) {
  std::vector<double> x;
  double x_sum = 0, lateral_sum = 0;
  for (const auto& scene : found) {
    x.push_back(scene[2 * row]);
    x_sum += scene[2 * row];
    lateral_sum += scene[2 * row + 1];
  }
  const double mean_error = std::sqrt(2 / std::numbers::pi) / static_cast<double>(found.size());
  return {p.axis,
          p.value,
          known,
          quantile(x, 0.5),
          quantile(x, 0.25),
          quantile(x, 0.75),
          mean_error * x_sum,
          mean_error * lateral_sum};
}

}  // namespace

Seen seen_by_spd(const Scene& scene, const Conditions& c, std::int64_t rays) {
  return see(scene, 0, c.half_tangent, c.half_tangent, c.spd_delay_ps / ps_per_m, rays);
}

Seen seen_by_radar(const Scene& scene, const Conditions& c, std::int64_t rays) {
  return see(as_radar_sees(scene), -c.baseline_m, radar_half_tangent, radar_half_tangent / 2,
             c.radar_bias_m, rays);
}

std::vector<Bound> study_bound(const BoundOptions& options) {
  check(options.conditions);
  const Laboratory laboratory(options);
  const auto found = rows_of_scenes("bound", options.scenes, options.quiet, [&](std::size_t i) {
    return SceneBounds(laboratory, options, study_kind(i), i).all();
  });
  std::vector<Bound> rows;
  for (const Point& p : laboratory.points())
    for (const char* known : known_names) rows.push_back(summary(p, known, found, rows.size()));
  return rows;
}

void write_bound(const std::vector<Bound>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "axis,value,known,x_median_m,x_lower_m,x_upper_m,x_error_m,lateral_error_m\n";
  for (const Bound& r : rows)
    csv << r.axis << ',' << r.value << ',' << r.known << ',' << r.x_median_m << ',' << r.x_lower_m
        << ',' << r.x_upper_m << ',' << r.x_error_m << ',' << r.lateral_error_m << '\n';
  write_atomically(folder + "/bound.csv", csv.str());
}

}  // namespace echofuse::sim
