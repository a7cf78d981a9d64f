// SPDX-License-Identifier: MIT
#include "sim/fit/surface.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace echofuse::sim {
namespace {

constexpr double same_surface_m = 0.12;
constexpr int parts = 4;

// Foreground depths in metres; 0: none.
std::vector<double> foreground(std::span<const std::uint16_t> mm,
                               std::span<const std::uint16_t> empty) {
  std::vector<double> z(mm.size());
  for (std::size_t i = 0; i < mm.size(); ++i) {
    const bool room = !empty.empty() && empty[i] > 0 && mm[i] + 100 > empty[i];
    z[i] = room ? 0 : mm[i] / 1000.0;
  }
  return z;
}

// The depth that parts plate and body: Otsu's threshold, which maximises the variance between both.
double threshold(const std::vector<double>& z) {
  std::vector<double> sorted;
  std::copy_if(z.begin(), z.end(), std::back_inserter(sorted), [](double v) { return v > 0; });
  std::sort(sorted.begin(), sorted.end());
  const auto n = static_cast<double>(sorted.size());
  double all = 0;
  for (const double v : sorted) all += v;
  double below = 0, best = -1, at = 0;
  for (std::size_t i = 0; i + 1 < sorted.size(); ++i) {
    below += sorted[i];
    const double k = static_cast<double>(i + 1);
    const double apart = below / k - (all - below) / (n - k);
    const double between = k * (n - k) * apart * apart;
    if (between > best) {
      best = between;
      at = (sorted[i] + sorted[i + 1]) / 2;
    }
  }
  return at;
}

class Builder {
 public:
  Builder(std::vector<double> z, const record::MapGrid& grid)
      : z_(std::move(z)), n_(grid.size), x_(grid.x()), y_(grid.y()) {}

  Surface build(bool letter) {
    const double plate_before = letter ? threshold(z_) : 0;
    Surface s;
    s.top = -std::numeric_limits<double>::infinity();
    s.foot = -s.top;
    double count = 0, square = 0, body_z = 0, body = 0, plate_z = 0, plate = 0, plate_y = 0;
    for (std::size_t i = 0; i < z_.size(); ++i) {
      const double z = z_[i];
      if (z <= 0) continue;
      const double x = z * x_.at(static_cast<double>(i % n_));
      const double y = z * y_.at(static_cast<double>(i / n_));
      const bool in_plate = z < plate_before;
      add_patches(i, in_plate, s.patches);
      s.area += z * z * x_.step * x_.step;
      s.top = std::max(s.top, y);
      s.foot = std::min(s.foot, y);
      s.x += x;
      s.z += z;
      square += x * x;
      ++count;
      (in_plate ? plate : body) += 1;
      (in_plate ? plate_z : body_z) += z;
      if (in_plate) plate_y += y;
      if (in_plate) s.plate_area += z * z * x_.step * x_.step;
    }
    if (count == 0) return {};
    s.x /= count;
    s.z /= count;
    s.width = std::sqrt(std::max(0.0, square / count - s.x * s.x));
    if (plate > 0 && body > 0) {
      s.plate_gap = body_z / body - plate_z / plate;
      s.plate_drop = s.top - plate_y / plate;
    }
    for (SurfacePatch& p : s.patches) {
      const double height = (p.y - s.foot) / std::max(0.1, s.top - s.foot);
      if (p.zone == Zone::torso && height > 0.87) p.zone = Zone::head;
      if (p.zone == Zone::torso && height < 0.5) p.zone = Zone::legs;
    }
    look_for_faults(s);
    return s;
  }

 private:
  // Change of z to the next pixel along one direction, on the same surface.
  double slope(std::size_t i, std::size_t stride, bool before, bool after) const {
    const auto same = [&](std::size_t j) {
      return z_[j] > 0 && std::abs(z_[j] - z_[i]) < same_surface_m;
    };
    before = before && same(i - stride);
    after = after && same(i + stride);
    if (before && after) return (z_[i + stride] - z_[i - stride]) / 2;
    if (before) return z_[i] - z_[i - stride];
    return after ? z_[i + stride] - z_[i] : 0;
  }

  void add_patches(std::size_t i, bool plate, std::vector<SurfacePatch>& out) const {
    const std::size_t column = i % n_, row = i / n_;
    const double per_x = slope(i, 1, column > 0, column + 1 < n_);
    const double per_y = slope(i, n_, row > 0, row + 1 < n_);
    const double tx = x_.at(static_cast<double>(column)), ty = y_.at(static_cast<double>(row));
    // Normal of P = z (tx, ty, 1): dP/dtx x dP/dty, up to its length.
    const double zx = per_x / x_.step, zy = per_y / y_.step, z = z_[i];
    const double normal =
        std::sqrt(z * z * zx * zx + z * z * zy * zy + std::pow(z * (z + tx * zx + ty * zy), 2));
    const double ray = std::sqrt(tx * tx + ty * ty + 1);
    const double cosine = z * z / std::max(1e-9, normal * ray);
    const double weight = cosine * x_.step * x_.step / (ray * ray * ray) / (parts * parts);
    for (int a = 0; a < parts; ++a)
      for (int b = 0; b < parts; ++b) {
        const double u = (a + 0.5) / parts - 0.5, v = (b + 0.5) / parts - 0.5;
        const double there = z + u * per_x + v * per_y;
        out.push_back({there * (tx + u * x_.step), there * (ty + v * y_.step), there, weight,
                       plate ? Zone::plate : Zone::torso});
      }
  }

  void look_for_faults(Surface& s) const {
    double rough = 0, smooth = 0, holes = 0, between = 0;
    for (std::size_t i = 1; i + 1 < z_.size(); ++i) {
      if (i % n_ == 0 || i % n_ + 1 == n_ || z_[i - 1] <= 0 || z_[i + 1] <= 0) continue;
      ++between;
      holes += z_[i] <= 0;
      const double bend = std::abs(z_[i - 1] - 2 * z_[i] + z_[i + 1]);
      if (z_[i] <= 0 || bend > 0.1) continue;
      rough += bend;
      ++smooth;
    }
    s.roughness = smooth > 0 ? rough / smooth : 0;
    s.holes = between > 0 ? holes / between : 0;
  }

  std::vector<double> z_;
  std::size_t n_;
  Axis x_, y_;
};

}  // namespace

Surface surface_of(std::span<const std::uint16_t> depth_mm, std::span<const std::uint16_t> empty_mm,
                   const record::MapGrid& grid, bool letter) {
  return Builder(foreground(depth_mm, empty_mm), grid).build(letter);
}

}  // namespace echofuse::sim
