// SPDX-License-Identifier: MIT
#include "acquire/peak.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include "drivers/core/axis.hpp"

namespace echofuse::acquire {
namespace {

constexpr double ps_per_m = 2e12 / speed_of_light_m_s;
constexpr double pi = std::numbers::pi;
constexpr double least_photon_snr = 10;  // amplitude over its standard error
constexpr double least_echo_db = 10;
constexpr std::size_t least_frames = 8;

std::string at(const char* text, double range_m) {
  char line[160];
  std::snprintf(line, sizeof line, text, range_m);
  return line;
}

bool inside(const Search& search, double range_m) {
  return std::abs(range_m - search.distance_m) <= search.window_m / 2;
}

std::string outside_text(double range_m) {
  return at("no peak in the window; the strongest is at %.3f m (a larger --window reaches it)",
            range_m);
}

// ---- SPD

struct Gaussian {
  double centre = 0, sigma = 1, photons = 0, floor = 0;  // bins, photons, counts a bin
};

double normal(double u) { return 0.5 * std::erfc(-u / std::numbers::sqrt2); }
double density(double u) { return std::exp(-u * u / 2) / std::sqrt(2 * pi); }

// Expected counts of bin i, and their derivatives by centre, ln sigma, photons, floor.
double expected(const Gaussian& g, double i, Eigen::Vector4d& slope) {
  const double a = (i - g.centre) / g.sigma, b = (i + 1 - g.centre) / g.sigma;
  const double share = normal(b) - normal(a);
  slope = {g.photons * (density(a) - density(b)) / g.sigma,
           g.photons * (a * density(a) - b * density(b)), share, 1};
  return g.photons * share + g.floor;
}

// Moments of what stands out around the highest of the counts, smoothed over `wide` bins.
Gaussian first_guess(std::span<const std::uint32_t> counts, std::size_t wide) {
  std::vector<double> sums(counts.size() + 1);
  for (std::size_t i = 0; i < counts.size(); ++i) sums[i + 1] = sums[i] + counts[i];
  std::size_t best = 0;
  for (std::size_t i = 0; i + wide <= counts.size(); ++i)
    if (sums[i + wide] - sums[i] > sums[best + wide] - sums[best]) best = i;
  std::vector<std::uint32_t> sorted(counts.begin(), counts.end());
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                   sorted.end());
  Gaussian g;
  g.floor = std::max<double>(sorted[sorted.size() / 2], 1e-3);
  const std::size_t from = best - std::min(best, wide),
                    to = std::min(best + 2 * wide, counts.size());
  double sum = 0, first = 0, second = 0;
  for (std::size_t i = from; i < to; ++i) {
    const double w = std::max(0.0, counts[i] - g.floor), x = static_cast<double>(i) + 0.5;
    sum += w;
    first += w * x;
    second += w * x * x;
  }
  g.photons = sum;
  g.centre = sum > 0 ? first / sum : static_cast<double>(best);
  g.sigma = sum > 0 ? std::sqrt(std::max(0.25, second / sum - g.centre * g.centre)) : 1;
  return g;
}

// One step of Fisher scoring over the bins [from, to); returns the information.
Eigen::Matrix4d score(std::span<const std::uint32_t> counts, std::size_t from, std::size_t to,
                      const Gaussian& g, Eigen::Vector4d& gradient) {
  Eigen::Matrix4d information = Eigen::Matrix4d::Zero();
  gradient.setZero();
  Eigen::Vector4d slope;
  for (std::size_t i = from; i < to; ++i) {
    const double mean = expected(g, static_cast<double>(i), slope);
    gradient += (counts[i] / mean - 1) * slope;
    information += slope * slope.transpose() / mean;
  }
  return information;
}

// The strongest other bump of `wide` bins, in sigmas above the fitted curve; and its place.
std::pair<double, double> rest(std::span<const std::uint32_t> counts, const Gaussian& g) {
  const auto wide = static_cast<std::size_t>(std::max(1.0, 2 * g.sigma));
  double best = 0, place = 0;
  Eigen::Vector4d unused;
  for (std::size_t i = 0; i + wide <= counts.size(); i += std::max<std::size_t>(1, wide / 2)) {
    if (std::abs(static_cast<double>(i + wide / 2) - g.centre) < 4 * g.sigma) continue;
    double seen = 0, mean = 0;
    for (std::size_t k = i; k < i + wide; ++k) {
      seen += counts[k];
      mean += expected(g, static_cast<double>(k), unused);
    }
    if (seen - mean > best) best = seen - mean, place = static_cast<double>(i + wide / 2);
  }
  return {best, place};
}

// ---- radar

// The Blackman window's transform, 1 at u = 0; u in cells of c / 2B.
double blackman(double u) {
  const auto sinc = [](double v) { return std::abs(v) < 1e-9 ? 1.0 : std::sin(pi * v) / (pi * v); };
  return sinc(u) + (0.25 * (sinc(u - 1) + sinc(u + 1)) + 0.04 * (sinc(u - 2) + sinc(u + 2))) / 0.42;
}

// Where between the bins the lobe's top is, relative to the middle one, from log2 of the power of
// 2n+1 bins; by golden-section search over +-1 bin.
double lobe_top(std::span<const double> log2_power, double cells_per_bin) {
  const auto middle = static_cast<double>(log2_power.size() / 2);
  const double highest = *std::max_element(log2_power.begin(), log2_power.end());
  const auto misfit = [&](double top) {
    double sum = 0, first = 0, second = 0;
    for (std::size_t i = 0; i < log2_power.size(); ++i) {
      const double u = (static_cast<double>(i) - middle - top) * cells_per_bin;
      const double model = 2 * std::log2(std::max(1e-6, std::abs(blackman(u))));
      const double weight = std::exp2(log2_power[i] - highest), d = log2_power[i] - model;
      sum += weight;
      first += weight * d;
      second += weight * d * d;
    }
    return second - first * first / sum;
  };
  constexpr double golden = 0.61803398874989485;
  double low = -1, high = 1;
  while (high - low > 1e-7) {
    const double a = high - golden * (high - low), b = low + golden * (high - low);
    (misfit(a) < misfit(b) ? high : low) = misfit(a) < misfit(b) ? b : a;
  }
  return (low + high) / 2;
}

}  // namespace

Peak fit_photons(std::span<const std::uint32_t> counts, double start_ps, double step_ps,
                 const Search& search) {
  Peak peak;
  const auto range_of = [&](double bin) { return (start_ps + bin * step_ps) / ps_per_m; };
  if (std::accumulate(counts.begin(), counts.end(), 0ull) < 100) {
    peak.refusal = "no peak: fewer than 100 photons came";
    return peak;
  }
  Gaussian g = first_guess(counts, static_cast<std::size_t>(std::max(1.0, 200 / step_ps)));
  const double reach = std::max(60.0, 12 * g.sigma);
  const auto border = [&](double x) {
    return static_cast<std::size_t>(std::clamp(x, 0.0, static_cast<double>(counts.size())));
  };
  const std::size_t from = border(g.centre - reach), to = border(g.centre + reach);
  Eigen::Vector4d gradient;
  Eigen::Matrix4d information;
  for (int step = 0; step < 60; ++step) {
    information = score(counts, from, to, g, gradient);
    const Eigen::Vector4d move = information.ldlt().solve(gradient);
    if (!move.allFinite()) break;
    g.centre += std::clamp(move[0], -g.sigma, g.sigma);
    g.sigma *= std::exp(std::clamp(move[1], -0.5, 0.5));
    g.photons = std::max(g.photons / 2, g.photons + move[2]);
    g.floor = std::max({g.floor / 2, g.floor + move[3], 1e-9});
    if (move.head<2>().norm() < 1e-6) break;
  }
  const Eigen::Matrix4d covariance = information.inverse();
  peak.range_m = range_of(g.centre);
  peak.standard_error_m = std::sqrt(covariance(0, 0)) * step_ps / ps_per_m;
  const double snr = g.photons / std::sqrt(covariance(2, 2));
  peak.snr_db = 20 * std::log10(snr);
  const auto [bump, place] = rest(counts, g);
  if (!(snr >= least_photon_snr) || !covariance.allFinite())
    peak.refusal = at("SNR too low: the strongest peak stands at %.3f m", peak.range_m);
  else if (!inside(search, peak.range_m))
    peak.refusal = outside_text(peak.range_m);
  else if (bump > 0.2 * g.photons && bump > 5 * std::sqrt(g.photons))
    peak.refusal = at("two peaks: another one at %.3f m", range_of(place));
  return peak;
}

Peak fit_echo(const std::vector<std::vector<std::uint16_t>>& frames, const EchoAxis& axis,
              const Search& search) {
  Peak peak;
  if (frames.size() < least_frames) {
    peak.refusal = "no peak: fewer than 8 frames came";
    return peak;
  }
  const std::size_t bins = frames[0].size();
  std::vector<double> mean(bins);  // log2 of the power
  for (const auto& frame : frames)
    for (std::size_t i = 0; i < bins; ++i)
      mean[i] += frame[i] * axis.log2_power_step / static_cast<double>(frames.size());
  // A window narrower than the lobe would miss a top between two bins.
  const double margin = std::max(search.window_m / 2, 1.5 * axis.step_m);
  const auto bin = [&](double range_m) {
    return static_cast<std::size_t>(
        std::clamp(std::round(range_m / axis.step_m), 2.0, static_cast<double>(bins) - 3));
  };
  const std::size_t low = bin(search.distance_m - margin), high = bin(search.distance_m + margin);
  const auto top = static_cast<std::size_t>(
      std::max_element(mean.begin() + static_cast<std::ptrdiff_t>(low),
                       mean.begin() + static_cast<std::ptrdiff_t>(high) + 1) -
      mean.begin());
  auto sorted = mean;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(bins / 2),
                   sorted.end());
  peak.snr_db = 10 * std::log10(2.0) * (mean[top] - sorted[bins / 2]);
  peak.range_m = static_cast<double>(top) * axis.step_m;
  // A lobe whose top is cut off: two bins of one code, the same in every frame.
  const bool flat = std::all_of(frames.begin(), frames.end(), [&](const auto& f) {
    return f[top] == frames[0][top] && (f[top] == f[top - 1] || f[top] == f[top + 1]);
  });
  if (flat) {
    peak.refusal = "saturated: lower the receiver's gain in profileCfg, or move the reflector away";
    return peak;
  }
  const auto strongest =
      static_cast<std::size_t>(std::max_element(mean.begin() + 2, mean.end() - 2) - mean.begin());
  const double strongest_db = 10 * std::log10(2.0) * (mean[strongest] - sorted[bins / 2]);
  const bool on_a_slope = mean[top - 1] > mean[top] || mean[top + 1] > mean[top];
  if (on_a_slope || (peak.snr_db < least_echo_db && strongest_db >= least_echo_db)) {
    peak.refusal = outside_text(static_cast<double>(strongest) * axis.step_m);
    return peak;
  }
  if (peak.snr_db < least_echo_db) {
    peak.refusal = at("SNR too low: %.1f dB over the median, 10 needed", peak.snr_db);
    return peak;
  }
  const double cells_per_bin = axis.step_m / axis.resolution_m;
  double sum = 0, squares = 0;
  for (const auto& frame : frames) {
    std::array<double, 3> near{};
    for (std::size_t k = 0; k < near.size(); ++k)
      near[k] = frame[top - 1 + k] * axis.log2_power_step;
    const double place = lobe_top(near, cells_per_bin);
    sum += place;
    squares += place * place;
  }
  const auto n = static_cast<double>(frames.size());
  const double shift = sum / n, variance = std::max(0.0, squares / n - shift * shift) * n / (n - 1);
  peak.range_m = (static_cast<double>(top) + shift) * axis.step_m;
  peak.standard_error_m = axis.step_m * std::sqrt(variance / n);
  // Another top outside this one's lobe (3 cells to its first null), within 6 dB.
  const auto lobe = static_cast<std::size_t>(std::ceil(3 / cells_per_bin));
  for (std::size_t i = low; i <= high; ++i)
    if ((i + lobe < top || i > top + lobe) && mean[i] > mean[i - 1] && mean[i] > mean[i + 1] &&
        mean[i] > mean[top] - 2)
      peak.refusal = at("two peaks: another one at %.3f m", static_cast<double>(i) * axis.step_m);
  if (peak.refusal.empty() && !inside(search, peak.range_m))
    peak.refusal = outside_text(peak.range_m);
  return peak;
}

}  // namespace echofuse::acquire
