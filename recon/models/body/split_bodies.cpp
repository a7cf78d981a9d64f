// SPDX-License-Identifier: MIT
#include "recon/models/body/split_bodies.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace echofuse::recon {
namespace {

constexpr double reach_m = 1.3;    // about the centroid of both
constexpr double smooth_m = 0.06;  // standard deviation, finer than bodies and coarser than noise
constexpr double least_apart_m = 0.35;  // nearer ones are within each other's depth
constexpr double deepest_valley = 0.5;  // of the lower peak; less is no valley
constexpr double least_share = 0.1;     // of the clicks, and of the power, for each body
constexpr double from_shift_m = -0.3, to_shift_m = 0.6, shift_step_m = 0.02;
constexpr double psf_step_m = 0.01;

using Values = std::vector<double>;

// In four sums, as an addition to one has to wait for the last one.
double dot(std::span<const double> a, std::span<const double> b) {
  std::array<double, 4> sums{};
  const std::size_t whole = a.size() / sums.size() * sums.size();
  for (std::size_t i = 0; i < whole; i += sums.size())
    for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += a[i + k] * b[i + k];
  for (std::size_t i = whole; i < a.size(); ++i) sums[0] += a[i] * b[i];
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

// Bins [from, cut) are the nearer body's, [cut, to) the other's.
struct Cut {
  std::size_t from, cut, to;
  std::array<double, 2> centre, clicks;  // bin, sum
};

Values smoothed(std::span<const float> clicks, double bins) {
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(3 * bins));
  Values out(clicks.size()), weights;
  for (std::ptrdiff_t k = -reach; k <= reach; ++k)
    weights.push_back(std::exp(-0.5 * static_cast<double>(k * k) / (bins * bins)));
  for (std::ptrdiff_t i = 0; i < std::ssize(clicks); ++i)
    for (std::ptrdiff_t k = -reach; k <= reach; ++k)
      if (i + k >= 0 && i + k < std::ssize(clicks))
        out[static_cast<std::size_t>(i)] += double{clicks[static_cast<std::size_t>(i + k)]} *
                                            weights[static_cast<std::size_t>(k + reach)];
  return out;
}

Cut measured(std::span<const float> clicks, std::size_t from, std::size_t cut, std::size_t to) {
  Cut out{from, cut, to, {}, {}};
  for (std::size_t i = from; i < to; ++i) {
    const std::size_t side = i >= cut;
    out.clicks[side] += double{clicks[i]};
    out.centre[side] += double{clicks[i]} * static_cast<double>(i);
  }
  for (std::size_t side = 0; side < 2; ++side) out.centre[side] /= out.clicks[side];
  return out;
}

// Where the variance between both sides is greatest (Otsu, IEEE Trans. SMC 9, 62, 1979), then at
// the valley between the two.
std::optional<Cut> cut_of(std::span<const float> clicks, const AlignmentRanges& spd) {
  const auto count = static_cast<double>(clicks.size());
  double from = 0, to = count, all = 0, moment = 0;
  for (int pass = 0; pass < 4; ++pass) {
    all = moment = 0;
    for (auto i = static_cast<std::size_t>(from); i < static_cast<std::size_t>(to); ++i) {
      const double weight = double{pass == 0 ? std::max(clicks[i], 0.f) : clicks[i]};
      all += weight, moment += weight * static_cast<double>(i);
    }
    if (all <= 0) return {};
    from = std::clamp(moment / all - reach_m / spd.step_m, 0.0, count);
    to = std::clamp(moment / all + reach_m / spd.step_m + 1, 0.0, count);
  }
  const auto first = static_cast<std::size_t>(from), last = static_cast<std::size_t>(to);
  double best = 0, near = 0, near_moment = 0;
  std::size_t cut = first;
  for (std::size_t i = first; i < last; ++i) {
    near += double{clicks[i]}, near_moment += double{clicks[i]} * static_cast<double>(i);
    if (near < least_share * all || all - near < least_share * all) continue;
    const double apart = (moment - near_moment) / (all - near) - near_moment / near;
    const double between = near * (all - near) * apart * apart;
    if (between > best) best = between, cut = i + 1;
  }
  if (best == 0) return {};
  const Cut rough = measured(clicks, first, cut, last);
  if (!(rough.centre[0] < rough.centre[1])) return {};
  const Values smooth = smoothed(clicks, smooth_m / spd.step_m);
  const auto at = [&](double bin) {
    return smooth.begin() + static_cast<std::ptrdiff_t>(std::clamp(bin, from, to - 1));
  };
  const auto valley = std::min_element(at(rough.centre[0]), at(rough.centre[1]) + 1);
  const double near_peak = *std::max_element(at(from), valley + 1),
               far_peak = *std::max_element(valley, at(to - 1) + 1);
  if (*valley > deepest_valley * std::min(near_peak, far_peak)) return {};
  const Cut out = measured(clicks, first, static_cast<std::size_t>(valley - smooth.begin()), last);
  const bool both = std::min(out.clicks[0], out.clicks[1]) > least_share * all;
  return both ? std::optional(out) : std::nullopt;
}

// The radar's power at distances from a point, in steps.
Values point_spread(double resolution_m, double farthest_m) {
  Values out(static_cast<std::size_t>(farthest_m / psf_step_m) + 2);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double x = M_PI * static_cast<double>(i) * psf_step_m / resolution_m;
    out[i] = i == 0 ? 1 : std::pow(std::sin(x) / x, 2);
  }
  return out;
}

// What the radar would see of one side, at each shift.
std::vector<Values> expected(std::span<const float> clicks, const Cut& cut, std::size_t side,
                             const AlignmentRanges& spd, const AlignmentRanges& radar,
                             std::size_t points, const Values& psf) {
  // At any distance, in the steps of the psf; a shift reads it elsewhere.
  const double start_m = radar.first_m - to_shift_m;
  const double span_m = to_shift_m - from_shift_m + static_cast<double>(points) * radar.step_m;
  Values unshifted(static_cast<std::size_t>(span_m / psf_step_m) + 2);
  const auto reach = std::ssize(psf) - 1, size = std::ssize(unshifted);
  const std::size_t first = side ? cut.cut : cut.from, last = side ? cut.to : cut.cut;
  for (std::size_t i = first; i < last; ++i) {
    const double range_m = spd.first_m + static_cast<double>(i) * spd.step_m;
    const auto middle = static_cast<std::ptrdiff_t>(std::lround((range_m - start_m) / psf_step_m));
    for (auto k = std::max<std::ptrdiff_t>(0, middle - reach);
         k < std::min(size, middle + reach + 1); ++k)
      unshifted[static_cast<std::size_t>(k)] +=
          double{clicks[i]} * psf[static_cast<std::size_t>(std::abs(k - middle))];
  }
  std::vector<Values> out;
  for (double shift_m = from_shift_m; shift_m < to_shift_m; shift_m += shift_step_m) {
    Values& profile = out.emplace_back(points);
    for (std::size_t j = 0; j < points; ++j) {
      const double at =
          (radar.first_m + static_cast<double>(j) * radar.step_m - shift_m - start_m) / psf_step_m;
      const auto k = std::min(static_cast<std::size_t>(at), unshifted.size() - 2);
      const double part = at - static_cast<double>(k);
      profile[j] = (1 - part) * unshifted[k] + part * unshifted[k + 1];
    }
  }
  return out;
}

struct Fit {
  std::array<std::size_t, 2> at{};  // of the shifts
  std::array<double, 2> amplitude{};
};

std::optional<Fit> fit(const Values& power, const std::vector<Values>& near,
                       const std::vector<Values>& far) {
  struct Own {
    double square, with_power;
  };
  const auto own = [&](const std::vector<Values>& profiles) {
    std::vector<Own> out;
    for (const Values& p : profiles) out.push_back({dot(p, p), dot(power, p)});
    return out;
  };
  const std::vector<Own> of_near = own(near), of_far = own(far);
  std::optional<Fit> out;
  double best = 0;
  for (std::size_t a = 0; a < near.size(); ++a)
    for (std::size_t b = 0; b < far.size(); ++b) {
      const auto [aa, pa] = of_near[a];
      const auto [bb, pb] = of_far[b];
      const double ab = dot(near[a], far[b]), of = aa * bb - ab * ab;
      if (!(of > 1e-9 * aa * bb)) continue;
      const double x = (pa * bb - pb * ab) / of, y = (pb * aa - pa * ab) / of;
      const double explained = x * pa + y * pb;
      if (x <= 0 || y <= 0 || explained <= best) continue;
      best = explained, out = Fit{{a, b}, {x, y}};
    }
  return out;
}

}  // namespace

std::optional<SplitBodies> split_bodies(const Alignment& alignment,
                                        std::span<const float> raw_inputs) {
  const AlignmentRanges spd = alignment.spd_ranges(), radar = alignment.radar_ranges();
  std::vector<float> clicks, power;
  alignment.subtract_background(raw_inputs, clicks, power);
  if (power.empty()) return {};
  const auto cut = cut_of(clicks, spd);
  if (!cut) return {};
  const double apart_m = (cut->centre[1] - cut->centre[0]) * spd.step_m;
  if (apart_m < std::max(alignment.resolution_m(), least_apart_m)) return {};
  const Values psf = point_spread(alignment.resolution_m(), 8 * alignment.resolution_m());
  std::array<std::vector<Values>, 2> profiles;
  for (std::size_t side = 0; side < 2; ++side)
    profiles[side] = expected(clicks, *cut, side, spd, radar, power.size(), psf);
  const auto found = fit(Values(power.begin(), power.end()), profiles[0], profiles[1]);
  if (!found) return {};
  std::array<double, 2> share;
  for (std::size_t side = 0; side < 2; ++side) {
    const Values& profile = profiles[side][found->at[side]];
    share[side] = found->amplitude[side] * std::accumulate(profile.begin(), profile.end(), 0.0);
  }
  if (std::min(share[0], share[1]) < least_share * (share[0] + share[1])) return {};
  SplitBodies out;
  for (std::size_t side = 0; side < 2; ++side) {
    SplitBodies::Part& part = out.parts[side];
    part.raw_inputs.assign(raw_inputs.begin(), raw_inputs.end());
    part.range_m = spd.first_m + cut->centre[side] * spd.step_m;
    part.shift_m = from_shift_m + static_cast<double>(found->at[side]) * shift_step_m;
    for (std::size_t i = 0; i < clicks.size(); ++i)
      if (i >= cut->from && i < cut->to && (i >= cut->cut) != (side == 1))
        part.raw_inputs[i] -= clicks[i];
    const Values& other = profiles[1 - side][found->at[1 - side]];
    for (std::size_t j = 0; j < power.size(); ++j)
      part.raw_inputs[clicks.size() + j] -=
          static_cast<float>(found->amplitude[1 - side] * other[j]);
  }
  return out;
}

}  // namespace echofuse::recon
