// SPDX-License-Identifier: MIT
#include "recon/method/array_view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "recon/data/column.hpp"

namespace echofuse::recon {
namespace {

constexpr double pi = std::numbers::pi;

}  // namespace

ArrayView::ArrayView(const Axis& lags) {
  if (lags.count == 0) return;
  up_ = lags_up(lags), across_ = static_cast<std::size_t>(lags.scale) - up_, bins_ = lags.count;
  first_m_ = lags.start, step_m_ = lags.step;
  part_m_ = std::max(step_m_, method::min_part_m);
  parts_ = 1 + static_cast<std::size_t>((method::part_to_m - method::part_from_m) / part_m_ + 1e-9);
}

std::size_t ArrayView::size() const {
  return across_ == 0 ? 0
                      : of_direction + 2 * lags_of(across_ + up_) +
                            parts_ * 2 * lags_of(std::size_t{method::lags_of_parts});
}

std::size_t ArrayView::lags_of(std::size_t max_lag) const {
  return std::min(across_, max_lag) + std::min(up_, max_lag);
}

std::size_t ArrayView::cost() const {
  if (across_ == 0) return 0;
  const auto in_window = static_cast<std::size_t>(
      std::ceil((method::profile_to_m - method::profile_from_m) / step_m_));
  return 3 * in_window * (2 * lags_of(across_ + up_) + 1) +
         std::size_t{method::directions} * 2 * across_;
}

void ArrayView::add(std::span<const float> bin, double weight, Lags& to) const {
  to[0] += weight * double{bin[0]};
  for (std::size_t d = 1; d < to.size(); ++d)
    to[d] += weight * std::complex<double>(bin[2 * d - 1], bin[2 * d]);
}

// Returns the direction cosine of the beam's maximum power, found by a grid search and Newton
// steps.
double ArrayView::direction_of(const Lags& sum) const {
  const auto antennas = static_cast<double>(across_ + 1);
  double best = 0, max_power = -INFINITY;
  for (int k = 0; k < method::directions; ++k) {
    const double u = -1 + 2 * (k + 0.5) / method::directions;
    const std::complex<double> turn = std::polar(1.0, -pi * u);
    std::complex<double> power = 1;
    double beam = 0;
    for (std::size_t d = 1; d <= across_; ++d) {
      power *= turn;
      beam += (antennas - static_cast<double>(d)) * (sum[d] * power).real();
    }
    if (beam > max_power) max_power = beam, best = u;
  }
  for (int i = 0; i < method::refinements; ++i) {
    double slope = 0, curvature = 0;
    for (std::size_t d = 1; d <= across_; ++d) {
      const double phase = pi * static_cast<double>(d), weight = antennas - static_cast<double>(d);
      const std::complex<double> turned = sum[d] * std::polar(1.0, -phase * best);
      slope += weight * phase * turned.imag(), curvature -= weight * phase * phase * turned.real();
    }
    if (!(curvature < 0)) break;
    best = std::clamp(best - std::clamp(slope / curvature, -0.02, 0.02), -1.0, 1.0);
  }
  return best;
}

void ArrayView::operator()(std::span<const float> lags, double range_m,
                           std::span<float> out) const {
  std::fill(out.begin(), out.end(), 0.f);
  const std::size_t lags_in_all = across_ + up_, values = 2 * lags_in_all + 1;
  Lags all(lags_in_all + 1);
  std::vector<Lags> parts(parts_, Lags(lags_in_all + 1));
  for (std::size_t b = 0; b < bins_; ++b) {
    const double at_m = first_m_ + static_cast<double>(b) * step_m_ - range_m;
    // A bin at the edge of the window is weighted by its fraction inside the window.
    const double within = std::clamp(
        std::min(at_m - method::profile_from_m, method::profile_to_m - at_m) / step_m_ + 0.5, 0.0,
        1.0);
    if (within == 0) continue;
    const auto bin = lags.subspan(b * values, values);
    add(bin, within, all);
    for (std::size_t k = 0; k < parts_; ++k) {
      const double off_m = at_m - method::part_from_m - static_cast<double>(k) * part_m_;
      const double weight = 1 - std::abs(off_m) / part_m_;
      if (weight > 0) add(bin, weight, parts[k]);
    }
  }
  if (!(all[0].real() > 0)) return;
  const double u = direction_of(all);
  out[0] = static_cast<float>(u), out[1] = static_cast<float>(u * range_m);
  std::size_t at = of_direction;
  const auto put = [&](const std::complex<double>& lag) {
    const auto share = lag / all[0].real();
    out[at++] = static_cast<float>(share.real()), out[at++] = static_cast<float>(share.imag());
  };
  const auto put_lags = [&](const Lags& sum, std::size_t max_lag) {
    for (std::size_t d = 1; d <= std::min(across_, max_lag); ++d)
      put(sum[d] * std::polar(1.0, -pi * static_cast<double>(d) * u));
    for (std::size_t d = 1; d <= std::min(up_, max_lag); ++d) put(sum[across_ + d]);
  };
  put_lags(all, lags_in_all);
  for (const Lags& part : parts) put_lags(part, std::size_t{method::lags_of_parts});
}

void ArrayView::turn(double by, double range_m, std::span<float> features) {
  features[0] += static_cast<float>(by);
  features[1] = static_cast<float>(double{features[0]} * range_m);
}

}  // namespace echofuse::recon
