// SPDX-License-Identifier: MIT
// Compares simulated histograms with published ones, which were measured with a TMF8820 or
// simulated by another group (Mu et al., CVPR 2024). Skipped if ECHOFUSE_DATA does not contain
// these data.
#include <array>
#include <cstring>
#include <nlohmann/json.hpp>

#include "../fixtures/data.hpp"
#include "../fixtures/folder.hpp"
#include "../fixtures/shell.hpp"
#include "sim/scene/mesh.hpp"
#include "sim/sensors/optics.hpp"
#include "sim/sensors/render.hpp"

using namespace echofuse::sim;
using test::data_folder;

namespace {

nlohmann::json read_json(const std::string& name) {
  const test::Outcome o = test::shell("gzip -dc '" + (data_folder() / name).string() + "'");
  REQUIRE(o.code == 0);
  return nlohmann::json::parse(o.text);
}

using Corners = std::vector<std::array<Vec3, 3>>;

Corners read_obj(const std::string& name) {
  const Mesh mesh = read_mesh(test::contents(data_folder() / name), name);
  Corners out;
  for (const auto& [a, b, c] : mesh.triangles)
    out.push_back({mesh.points[a], mesh.points[b], mesh.points[c]});
  return out;
}

// Reads a binary STL file. The file begins with a header of 80 bytes and the number of triangles.
// Each triangle has 12 floats (the normal and three corners) and two more bytes.
Corners read_stl(const std::string& name) {
  const std::string text = test::contents(data_folder() / name);
  Corners out;
  for (std::size_t at = 84; at + 50 <= text.size(); at += 50) {
    std::array<float, 12> v{};
    std::memcpy(v.data(), &text[at], sizeof v);
    out.push_back({Vec3{v[3], v[4], v[5]}, Vec3{v[6], v[7], v[8]}, Vec3{v[9], v[10], v[11]}});
  }
  return out;
}

// Sensor with three axes at a position. It looks along the z axis.
struct Pose {
  Vec3 x, y, z, place;
  explicit Pose(const nlohmann::json& p)
      : x(column(p, 0)), y(column(p, 1)), z(column(p, 2)), place(column(p, 3)) {}
  static Vec3 column(const nlohmann::json& p, std::size_t k) { return {p[0][k], p[1][k], p[2][k]}; }
};

Scene seen_from(const Pose& pose, const Corners& corners) {
  const auto from = [&](Vec3 p) {
    const Vec3 d = p - pose.place;
    return Vec3{dot(d, pose.x), dot(d, pose.y), dot(d, pose.z)};
  };
  Scene scene;
  for (const auto& [a, b, c] : corners) scene.triangles.push_back({from(a), from(b), from(c), 0.5});
  return scene;
}

// Returns the light received from a circular field of view. `half_tangent` is the tangent of half
// the opening angle.
Returns look(const Scene& scene, double half_tangent) {
  constexpr std::uint32_t rays = 256;
  const double step = 2 * half_tangent / rays, first = -half_tangent + step / 2;
  const Axis x{"x", "tangent", "1", rays, first, step};
  const std::vector<Hit> hits = cast(scene, 0, x, x);
  Returns out;
  for (std::uint32_t iy = 0; iy < rays; ++iy)
    for (std::uint32_t ix = 0; ix < rays; ++ix) {
      const Hit& hit = hits[std::size_t{iy} * rays + ix];
      const double t2 = x.at(ix) * x.at(ix) + x.at(iy) * x.at(iy);
      if (hit.range_m == 0 || t2 > half_tangent * half_tangent) continue;
      out.range_m.push_back(hit.range_m);
      out.weight.push_back(hit.albedo * hit.cos_theta * step * step / std::pow(1 + t2, 1.5) /
                           (hit.range_m * hit.range_m));
    }
  return out;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct Fit {
  double gain = 0, background = 0;
};

// Fits counts = gain * model + background by weighted least squares. The variances are computed
// from the rates found in the previous iteration.
Fit fit(const std::vector<double>& counts, const std::vector<double>& model,
        const std::vector<double>& seen_share) {
  Fit out;
  std::vector<double> variance(counts.size(), 1);
  for (int round = 0; round < 6; ++round) {
    double mm = 0, m = 0, one = 0, mc = 0, c = 0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double v = 1 / variance[i];
      mm += v * model[i] * model[i], m += v * model[i], one += v;
      mc += v * model[i] * counts[i], c += v * counts[i];
    }
    const double det = mm * one - m * m;
    out = {(mc * one - m * c) / det, (mm * c - m * mc) / det};
    for (std::size_t i = 0; i < counts.size(); ++i)
      variance[i] = std::max(0.05, out.gain * model[i] + out.background) / seen_share[i];
  }
  return out;
}

// Returns the fractional bin number at which the smoothed counts first exceed a third of their
// peak. Each smoothed count is the average of 2 * width + 1 bins.
double first_return(const std::vector<double>& counts, std::size_t from, std::size_t width) {
  std::vector<double> smooth(counts.size());
  for (std::size_t i = width; i + width < counts.size(); ++i)
    for (std::size_t j = i - width; j <= i + width; ++j)
      smooth[i] += counts[j] / static_cast<double>(2 * width + 1);
  const double most =
      *std::max_element(smooth.begin() + static_cast<std::ptrdiff_t>(from), smooth.end());
  for (std::size_t i = from + 1; i < smooth.size(); ++i)
    if (smooth[i] > most / 3)
      return static_cast<double>(i) - (smooth[i] - most / 3) / (smooth[i] - smooth[i - 1]);
  return NAN;
}

// Returns the absolute deviations of the shifts from their median.
std::vector<double> scatter(const std::vector<double>& shifts) {
  std::vector<double> off;
  for (const double s : shifts) off.push_back(std::abs(s - median(shifts)));
  return off;
}

constexpr double tmf_half_tangent = 0.29;

// The publication does not state the bin width. If the simulator counts only the first photon of
// each of 5000 pulses, the background is equal in front of and behind the object.
TEST_CASE("simulated histograms of a sphere and a soap dish match those of another simulator") {
  const std::string name = GENERATE("sphere", "soap");
  CAPTURE(name);
  const auto records = read_json("spad-simulated/" + name + ".json.gz");
  const Corners corners = read_obj("spad-simulated/" + name + ".obj");
  const double pulses = 5000, mm_a_bin = 1.245;
  Conditions c;
  c.half_tangent = 0.268, c.spd_rays = 256;
  c.bins = 1024, c.first_bin_ps = 0, c.bin_width_ps = mm_a_bin * ps_per_m / 1000;
  c.irf_fwhm_ps = 60, c.signal_photons = 1;
  std::vector<double> chi2s, shifts;
  for (std::size_t k = 0; k < records.size(); k += 4) {
    const std::vector<double> counts = records[k]["hists"];
    const auto model =
        spd_rate(look(seen_from(Pose(records[k]["pose"]), corners), c.half_tangent), c);
    std::vector<double> low(counts.size()), seen(counts.size());
    double before = 0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      seen[i] = 1 - before / pulses;
      low[i] = -pulses * std::log1p(-counts[i] / (pulses - before));
      before += counts[i];
    }
    const Fit found = fit(low, model, seen);
    double chi2 = 0, groups = -2, expected = 0, counted = 0, clicks = 0;
    for (std::size_t i = 0; i < counts.size(); ++i) {
      const double q = (found.gain * model[i] + found.background) / pulses;
      expected += pulses * std::exp(-clicks) * (1 - std::exp(-q)), counted += counts[i],
          clicks += q;
      if (expected < 10) continue;
      chi2 += (counted - expected) * (counted - expected) / expected, ++groups;
      expected = counted = 0;
    }
    chi2s.push_back(chi2 / groups);
    std::vector<double> object = low;
    for (double& n : object) n -= found.background;
    shifts.push_back(first_return(object, 4, 4) - first_return(model, 4, 4));
  }
  CHECK(median(chi2s) < 1.5);
  CHECK(std::abs(mm_a_bin * median(shifts)) < 2);
  CHECK(mm_a_bin * median(scatter(shifts)) < 1);
}

// Model of the cover window of a TMF8820. The strong first peak that the window causes has the
// shape of the detector response.
class Window {
 public:
  static constexpr std::size_t first = 16, last = 20, bins = 128;
  // Measures the background of each bin relative to the height of the peak. A low percentile over
  // all poses is used, so that the moving object does not contribute.
  Window(const nlohmann::json& records, std::size_t zone) : seen_(bins), until_(bins + 1) {
    for (std::size_t i = 0; i < bins; ++i) {
      std::vector<double> values;
      for (const auto& r : records) {
        const std::vector<double> h = r["hists"][zone];
        values.push_back(h[i] / peak(h));
      }
      std::nth_element(values.begin(), values.begin() + 4, values.end());
      seen_[i] = values[4];
    }
    double near = 0;
    for (std::size_t i = 14; i < bins; ++i) {
      const double light = i > 50 ? 0 : std::max(0.0, seen_[i] - seen_[90]);
      until_[i + 1] = until_[i] + light;
      if (i < 22) near += light, centre_ += light * (static_cast<double>(i) + 0.5);
    }
    centre_ /= near;
    for (double& light : until_) light /= until_[bins];
  }
  static double peak(const std::vector<double>& h) {
    return std::accumulate(h.begin() + first, h.begin() + last, 0.0);
  }
  const std::vector<double>& seen() const { return seen_; }
  // Returns the fraction of the detector response that falls into bin i for light arriving at bin
  // `at`.
  double share(std::size_t i, double at) const {
    const double begin = static_cast<double>(i) - at + centre_;
    return up_to(begin + 1) - up_to(begin);
  }

 private:
  double up_to(double x) const {
    if (x <= 0) return 0;
    if (x >= bins) return 1;
    const auto i = static_cast<std::size_t>(x);
    return until_[i] + (x - static_cast<double>(i)) * (until_[i + 1] - until_[i]);
  }
  std::vector<double> seen_, until_;
  double centre_ = 0;
};

// Returns the pose of a zone. The zones form a 3 x 3 grid that covers 33 by 32 degrees and is
// rotated by 180 degrees.
Pose of_zone(Pose pose, std::size_t zone) {
  const double x = (1 - static_cast<double>(zone / 3)) * 2 / 3 * tmf_half_tangent,
               y = (1 - static_cast<double>(zone % 3)) * 2 / 3 * tmf_half_tangent;
  pose.z = pose.z + x * pose.x + y * pose.y;
  pose.z = 1 / length(pose.z) * pose.z;
  pose.x = pose.x - dot(pose.x, pose.z) * pose.z;
  pose.x = 1 / length(pose.x) * pose.x;
  pose.y = cross(pose.z, pose.x);
  return pose;
}

// The bin size of 13.5 mm and the zero position at bin 12.25 were fitted in advance. Only the delay
// of each zone is fitted in the test.
TEST_CASE("simulated histograms of a block match those measured with a TMF8820") {
  const auto records = read_json("spad-tmf8820/tall_block.json.gz");
  const Corners corners = read_stl("spad-tmf8820/tall_block.stl");
  constexpr double m_a_bin = 0.0135, zero_bin = 12.25, step_m = 0.002;
  // Bins from 21 on are behind the peak of the cover window.
  constexpr std::size_t from = 21, to = 60;
  std::vector<double> off, rests;
  for (std::size_t zone = 0; zone < 9; ++zone) {
    const Window window(records, zone);
    std::vector<double> shifts;
    for (const auto& r : records) {
      Conditions c;
      c.half_tangent = tmf_half_tangent / 3, c.spd_rays = 64;
      const Returns returns = spd_returns(seen_from(of_zone(Pose(r["pose"]), zone), corners), c);
      std::vector<double> light(600), model(Window::bins), object(Window::bins);
      for (std::size_t k = 0; k < returns.range_m.size(); ++k)
        if (const double step = returns.range_m[k] / step_m; step < 600)
          light[static_cast<std::size_t>(step)] += returns.weight[k];
      const std::vector<double> h = r["hists"][zone];
      const double peak = Window::peak(h);
      double mm = 0, mo = 0, oo = 0;
      for (std::size_t i = from; i < Window::bins; ++i) {
        for (std::size_t k = 0; k < light.size(); ++k)
          if (light[k] != 0)
            model[i] +=
                light[k] *
                window.share(i, (static_cast<double>(k) + 0.5) * step_m / m_a_bin + zero_bin);
        object[i] = h[i] - peak * window.seen()[i];
        if (i >= to) continue;
        mm += model[i] * model[i], mo += model[i] * object[i], oo += object[i] * object[i];
      }
      // The share of the squares that the best multiple of the model does not explain.
      rests.push_back(1 - mo * mo / (mm * oo));
      const double measured = first_return(object, from, 0),
                   expected = first_return(model, from, 0);
      if (std::min(measured, expected) > from + 1.5)
        shifts.push_back(1000 * m_a_bin * (measured - expected));
    }
    std::ranges::copy(scatter(shifts), std::back_inserter(off));
  }
  CHECK(median(off) < 5);
  CHECK(median(rests) < 0.15);
}

}  // namespace

int main(int argc, char** argv) {
  return echofuse::test::run_with_data(argc, argv, "spad-simulated");
}
