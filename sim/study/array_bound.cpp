// SPDX-License-Identifier: MIT
#include "sim/study/array_bound.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <iomanip>
#include <numbers>
#include <sstream>

#include "drivers/core/atomic_write.hpp"
#include "sim/scene/scene.hpp"
#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {
namespace {

using Complex = std::complex<double>;
using CMatrix = Eigen::MatrixXcd;

constexpr double pi = std::numbers::pi;
constexpr int most_antennas = 8, base_looks = 60;
constexpr double cells_a_resolution = 32;  // of range, for the sum over patches
constexpr double step_rad = 1e-4, step_m = 1e-4;

// A point of the study's axes.
struct Point {
  std::string axis;
  double value;
  int antennas = most_antennas, looks = base_looks;
  double snr_db = 20, phase_error_deg = 0;
};

std::vector<Point> points() {
  std::vector<Point> out;
  for (const int looks : {1, 10, base_looks}) {
    out.push_back({"looks", double(looks)});
    out.back().looks = looks;
  }
  for (const double snr : {10, 15, 25, 30}) {
    out.push_back({"snr_db", snr});
    out.back().snr_db = snr;
  }
  for (const int antennas : {2, 4}) {
    out.push_back({"antennas", double(antennas)});
    out.back().antennas = antennas;
  }
  for (const double error : {1, 5, 10, 20}) {
    out.push_back({"phase_error_deg", error});
    out.back().phase_error_deg = error;
  }
  return out;
}

// Patches as the radar sees them, in the SPD's frame.
struct Patch {
  double x, y, z, weight;
};

// R as a function of how far the scene is turned about the SPD and of the radar's range bias.
class Echoes {
 public:
  Echoes(const Scene& scene, const Conditions& c, std::int64_t rays)
      : axis_(radar_response(c)), baseline_m_(c.baseline_m) {
    const Seen seen = seen_by_radar(scene, c, rays);
    for (std::size_t i = 0; i < seen.range_m.size(); ++i) {
      const double range_m = seen.range_m[i] - c.radar_bias_m;
      const double x = seen.cosine_x[i] * range_m, z = seen.cosine_z[i] * range_m;
      const double y = std::sqrt(std::max(0.0, range_m * range_m - x * x - z * z));
      patches_.push_back({x - c.baseline_m, y, z, seen.weight[i]});
      nearest_m_ = std::min(nearest_m_, range_m), farthest_m_ = std::max(farthest_m_, range_m);
      z_m_ += z / static_cast<double>(seen.range_m.size());
    }
    for (std::uint32_t i = 0; i < axis_.count; ++i) {
      const double at_m = axis_.start_m + i * axis_.step_m;
      if (at_m > nearest_m_ - axis_.resolution_m && at_m < farthest_m_ + axis_.resolution_m)
        points_m_.push_back(at_m);
    }
  }
  double z_m() const { return z_m_; }

  // Points of range times antennas, antennas fastest.
  CMatrix covariance(int antennas, double turned_rad, double bias_m) const {
    // Of each cell of range, which its neighbour shares linearly: sum of w exp(i pi d u).
    const double cell_m = axis_.resolution_m / cells_a_resolution;
    const double first_m = nearest_m_ - 0.2;
    const auto cells = static_cast<Eigen::Index>((farthest_m_ + 0.2 - first_m) / cell_m) + 2;
    CMatrix lags = CMatrix::Zero(cells, antennas);
    const double cosine = std::cos(turned_rad), sine = std::sin(turned_rad);
    for (const Patch& p : patches_) {
      const double x = p.x * cosine + p.z * sine + baseline_m_, z = p.z * cosine - p.x * sine;
      const double range_m = std::sqrt(x * x + p.y * p.y + z * z);
      const double at = (range_m + bias_m - first_m) / cell_m;
      const auto cell = static_cast<Eigen::Index>(at);
      if (at < 0 || cell + 1 >= cells) continue;
      const double part = at - static_cast<double>(cell);
      const Complex turn = std::polar(1.0, pi * x / range_m);
      Complex wave = p.weight;
      for (int d = 0; d < antennas; ++d, wave *= turn)
        lags(cell, d) += (1 - part) * wave, lags(cell + 1, d) += part * wave;
    }
    const auto count = static_cast<Eigen::Index>(points_m_.size());
    Eigen::MatrixXd psf(count, cells);
    for (Eigen::Index i = 0; i < count; ++i)
      for (Eigen::Index r = 0; r < cells; ++r)
        psf(i, r) = psf_amplitude(axis_.psf, (points_m_[static_cast<std::size_t>(i)] - first_m -
                                              static_cast<double>(r) * cell_m) /
                                                 axis_.resolution_m);
    CMatrix out(count * antennas, count * antennas);
    for (int d = 0; d < antennas; ++d) {
      const CMatrix of_lag = psf * lags.col(d).asDiagonal() * psf.transpose();
      for (Eigen::Index i = 0; i < count; ++i)
        for (Eigen::Index j = 0; j < count; ++j)
          for (int n = 0; n + d < antennas; ++n) {
            out(i * antennas + n + d, j * antennas + n) = of_lag(i, j);
            out(j * antennas + n, i * antennas + n + d) = std::conj(of_lag(i, j));
          }
    }
    return out;
  }

 private:
  RadarAxis axis_;
  double baseline_m_, nearest_m_ = INFINITY, farthest_m_ = 0, z_m_ = 0;
  std::vector<Patch> patches_;
  std::vector<double> points_m_;
};

// The slopes of R in the basis of its eigenvectors: by azimuth, gain, bias, then each antenna's
// phase.
class Slopes {
 public:
  Slopes(const Echoes& echoes, int antennas) : antennas_(antennas) {
    const CMatrix r = echoes.covariance(antennas, 0, 0);
    const Eigen::SelfAdjointEigenSolver<CMatrix> solver(r);
    power_ = solver.eigenvalues().cwiseMax(0.0);
    const CMatrix& v = solver.eigenvectors();
    const auto add = [&](const CMatrix& slope) {
      const CMatrix half = slope * v;
      slopes_.push_back(v.adjoint() * half);
    };
    add((echoes.covariance(antennas, step_rad, 0) - echoes.covariance(antennas, -step_rad, 0)) /
        (2 * step_rad));
    const CMatrix eigenvalues = solver.eigenvalues().cast<Complex>().asDiagonal();
    slopes_.push_back(eigenvalues);
    add((echoes.covariance(antennas, 0, step_m) - echoes.covariance(antennas, 0, -step_m)) /
        (2 * step_m));
    // i (D R - R D), where D keeps the rows of one antenna.
    for (int m = 0; m < antennas; ++m) {
      CMatrix rows(r.rows() / antennas, r.cols());
      for (Eigen::Index i = 0; i < rows.rows(); ++i) rows.row(i) = v.row(i * antennas + m);
      const CMatrix kept = rows.adjoint() * rows;
      slopes_.push_back(Complex(0, 1) * (kept * eigenvalues.diagonal().asDiagonal() -
                                         eigenvalues.diagonal().asDiagonal() * kept));
    }
  }

  // Radians.
  double deviation(const Point& p, double noise, bool coherent, ArrayUse use) const {
    std::vector<std::size_t> unknown = {0, 1};
    if (use == ArrayUse::angle) unknown.push_back(2);
    if (p.phase_error_deg > 0 && use != ArrayUse::range)
      for (int m = 0; m < antennas_; ++m) unknown.push_back(static_cast<std::size_t>(3 + m));
    const Eigen::Index n = power_.size();
    Eigen::MatrixXd weight(n, n);
    for (Eigen::Index i = 0; i < n; ++i)
      for (Eigen::Index j = 0; j < n; ++j)
        weight(i, j) = p.looks / (coherent ? (power_[i] + noise) * (power_[j] + noise)
                                           : noise * (power_[i] + power_[j] + noise));
    Matrix m(unknown.size(), Values(unknown.size()));
    for (std::size_t a = 0; a < unknown.size(); ++a) {
      for (std::size_t b = 0; b <= a; ++b)
        m[a][b] = m[b][a] = slopes_[unknown[a]]
                                .conjugate()
                                .cwiseProduct(slopes_[unknown[b]])
                                .real()
                                .cwiseProduct(weight)
                                .sum();
      if (unknown[a] >= 3) m[a][a] += std::pow(180 / pi / p.phase_error_deg, 2);
    }
    Values azimuth(unknown.size());
    azimuth[0] = 1;
    return least_deviation(m, azimuth);
  }

 private:
  int antennas_;
  Eigen::VectorXd power_;
  std::vector<CMatrix> slopes_;
};

std::vector<Conditions> radars(const Conditions& base) {
  std::vector<Conditions> out = {base, base};
  constexpr double fine_m = 0.044;
  Conditions& fine = out.back();
  fine.radar_step_m *= fine_m / base.radar_resolution_m;
  fine.radar_bins = 1 + std::lround(static_cast<double>(base.radar_bins - 1) * base.radar_step_m /
                                    fine.radar_step_m);
  fine.radar_resolution_m = fine_m;
  return out;
}

template <class Visit>
void for_each_row(const std::vector<Conditions>& all, const Visit& visit) {
  for (std::size_t radar = 0; radar < all.size(); ++radar)
    for (const bool coherent : {true, false})
      for (const Point& p : points())
        for (const auto use : {ArrayUse::range, ArrayUse::angle, ArrayUse::both})
          visit(radar, coherent, p, use);
}

// Metres, of all rows.
std::vector<double> bounds_of(const Scene& scene, const std::vector<Conditions>& all,
                              const std::vector<double>& mean_peak, std::int64_t rays) {
  std::vector<std::vector<Slopes>> slopes;
  double z_m = 0;
  const std::vector<int> counts = {1, 2, 4, most_antennas};
  for (const Conditions& c : all) {
    const Echoes echoes(scene, c, rays);
    z_m = echoes.z_m();
    auto& own = slopes.emplace_back();
    for (const int antennas : counts) own.emplace_back(echoes, antennas);
  }
  std::vector<double> out;
  for_each_row(all, [&](std::size_t radar, bool coherent, const Point& p, ArrayUse use) {
    const int antennas = use == ArrayUse::range ? 1 : p.antennas;
    const auto at = std::find(counts.begin(), counts.end(), antennas) - counts.begin();
    const double noise = std::pow(10, -p.snr_db / 10) * mean_peak[radar];
    out.push_back(z_m *
                  slopes[radar][static_cast<std::size_t>(at)].deviation(p, noise, coherent, use));
  });
  return out;
}

}  // namespace

std::vector<ArrayBound> study_array_bound(const BoundOptions& options) {
  const std::vector<Conditions> all = radars(options.conditions);
  std::vector<double> mean_peak;
  for (const Conditions& c : all) mean_peak.push_back(mean_peak_power(radar_response(c), c));
  const auto found = rows_of_scenes(
      options.parts, "bound_array", "bound of the antennas", options.scenes, options.quiet,
      [&](std::size_t i) {
        return bounds_of(make_scene(options.conditions, study_kind(i), options.seed, i), all,
                         mean_peak, options.rays);
      });
  std::vector<ArrayBound> rows;
  if (options.parts.part) return rows;
  for_each_row(all, [&](std::size_t radar, bool coherent, const Point& p, ArrayUse use) {
    double sum = 0;
    for (const auto& scene : found) sum += scene[rows.size()];
    rows.push_back({coherent ? "coherent" : "incoherent", p.axis, p.value,
                    all[radar].radar_resolution_m, use,
                    std::sqrt(2 / pi) * sum / static_cast<double>(found.size())});
  });
  return rows;
}

std::string to_text(const std::vector<ArrayBound>& rows) {
  std::ostringstream out;
  out << "echoes       axis             value  resolution m  use    lateral error m\n";
  for (const ArrayBound& r : rows)
    out << std::left << std::setw(13) << r.echoes << std::setw(16) << r.axis << std::right
        << std::setw(6) << r.value << std::setw(14) << r.resolution_m << "  " << std::left
        << std::setw(7) << array_use_names[static_cast<std::size_t>(r.use)] << std::right
        << std::fixed << std::setprecision(4) << r.lateral_error_m << std::defaultfloat << '\n';
  return out.str();
}

void write_array_bound(const std::vector<ArrayBound>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "echoes,axis,value,resolution_m,use,lateral_error_m\n";
  for (const ArrayBound& r : rows)
    csv << r.echoes << ',' << r.axis << ',' << r.value << ',' << r.resolution_m << ','
        << array_use_names[static_cast<std::size_t>(r.use)] << ',' << r.lateral_error_m << '\n';
  write_atomically(folder + "/bound_array.csv", csv.str());
}

}  // namespace echofuse::sim
