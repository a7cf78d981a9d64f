// SPDX-License-Identifier: MIT
#include "acquire/calibrate/peak.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include "acquire/calibrate/echo_model.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/core/median.hpp"
#include "drivers/core/sample.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double min_photon_snr = 10;  // minimum ratio of the amplitude to its standard error
constexpr double min_echo_db = 10;
constexpr std::size_t min_bins = 8;
// Error of the vertex of a parabola through log powers, in bins. This value applies if there is one
// bin per resolution cell and the lobe is at most as wide as that of a Hann window.
constexpr double parabola_error = 0.02;

bool inside(const Search& search, double range_m) {
  return std::abs(range_m - search.distance_m) <= search.window_m / 2;
}

// Rejects a peak because its range, `range_m`, is outside the window. `advice` names the likely
// cause.
void refuse_outside(Peak& peak, double range_m, const std::string& advice) {
  peak.range_m = range_m;
  peak.outside = true;
  peak.refusal =
      format("no peak in the search window; the strongest peak is at %.3f m: ", range_m) + advice;
}

constexpr char place_advice[] = "check --distance, and that the reflector faces the radar";

std::string delay_advice(const Search& search, double range_m) {
  return format(
      "check --distance; if a cable or fibre delays the clicks, add %.0f ps to tdc.click_delay_ps",
      (search.distance_m - range_m) * ps_per_m);
}

// ---- SPD: fit of a pulse

struct PhotonPeak {
  // Centre and sigma in bins, number of photons, background in counts per bin.
  double centre = 0, sigma = 1, photons = 0, floor = 0;
};

double normal(double u) { return 0.5 * std::erfc(-u / std::numbers::sqrt2); }
double density(double u) { return std::exp(-u * u / 2) / std::sqrt(2 * pi); }

// Returns the expected number of counts in bin i. Sets `slope` to the derivatives with respect to
// centre, ln sigma, photons and floor.
double expected(const PhotonPeak& g, double i, Eigen::Vector4d& slope) {
  const double a = (i - g.centre) / g.sigma, b = (i + 1 - g.centre) / g.sigma;
  const double share = normal(b) - normal(a);
  slope = {g.photons * (density(a) - density(b)) / g.sigma,
           g.photons * (a * density(a) - b * density(b)), share, 1};
  return g.photons * share + g.floor;
}

// Range [from, to) of histogram bins.
struct BinRange {
  std::size_t from = 0, to = 0;
};

// Estimates the peak from the moments of the counts above the background. Starts from the group of
// `wide` adjacent bins in `where` that has the largest sum.
PhotonPeak first_guess(std::span<const std::uint32_t> counts, std::size_t wide, BinRange where) {
  std::vector<double> sums(counts.size() + 1);
  for (std::size_t i = 0; i < counts.size(); ++i) sums[i + 1] = sums[i] + counts[i];
  std::size_t best = where.from;
  for (std::size_t i = where.from; i + wide <= where.to; ++i)
    if (sums[i + wide] - sums[i] > sums[best + wide] - sums[best]) best = i;
  const std::size_t from = best - std::min(best, wide),
                    to = std::min(best + 2 * wide, counts.size());
  const std::size_t around_from = best - std::min(best, 8 * wide),
                    around_to = std::min(best + 9 * wide, counts.size());
  const std::vector<std::uint32_t> around(counts.begin() + static_cast<std::ptrdiff_t>(around_from),
                                          counts.begin() + static_cast<std::ptrdiff_t>(around_to));
  PhotonPeak g;
  g.floor = std::max<double>(median(around), 1e-3);
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

// Computes the gradient of the log-likelihood over the bins [from, to). Returns the Fisher
// information.
Eigen::Matrix4d score(std::span<const std::uint32_t> counts, std::size_t from, std::size_t to,
                      const PhotonPeak& g, Eigen::Vector4d& gradient) {
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

struct PhotonPeakFit {
  PhotonPeak peak;
  double centre_error = 0;  // standard error of the centre in bins
  double snr = 0;           // ratio of the number of photons to its standard error; 0: no fit
};

PhotonPeakFit fit_around(std::span<const std::uint32_t> counts, std::size_t wide, BinRange where) {
  PhotonPeakFit fit;
  PhotonPeak& g = fit.peak;
  g = first_guess(counts, wide, where);
  const double reach = std::max(3.0 * static_cast<double>(wide), 12 * g.sigma);
  const auto border = [&](double x) {
    return static_cast<std::size_t>(std::clamp(x, 0.0, static_cast<double>(counts.size())));
  };
  const std::size_t from = border(g.centre - reach), to = border(g.centre + reach);
  Eigen::Vector4d gradient;
  Eigen::Matrix4d information;
  for (int step = 0; step < 60; ++step) {
    information = score(counts, from, to, g, gradient);
    const Eigen::Vector4d move = information.ldlt().solve(gradient);
    if (!move.allFinite()) return fit;
    g.centre += std::clamp(move[0], -g.sigma, g.sigma);
    g.sigma *= std::exp(std::clamp(move[1], -0.5, 0.5));
    g.photons = std::max(g.photons / 2, g.photons + move[2]);
    g.floor = std::max({g.floor / 2, g.floor + move[3], 1e-9});
    if (move.head<2>().norm() < 1e-6) break;
  }
  const Eigen::Matrix4d covariance = information.inverse();
  if (!covariance.allFinite() || !(covariance(0, 0) > 0) || !(covariance(2, 2) > 0)) return fit;
  fit.centre_error = std::sqrt(covariance(0, 0));
  fit.snr = g.photons / std::sqrt(covariance(2, 2));
  return fit;
}

struct SecondPeak {
  double photons = 0, bin = 0;
};

// Finds the strongest peak within `where` other than the fitted one, assuming the same width.
SecondPeak other_bump(std::span<const std::uint32_t> counts, const PhotonPeak& g, BinRange where) {
  const auto wide = static_cast<std::size_t>(std::max(1.0, 2 * g.sigma));
  SecondPeak best;
  Eigen::Vector4d unused;
  for (std::size_t i = where.from; i + wide <= where.to; i += std::max<std::size_t>(1, wide / 2)) {
    if (std::abs(static_cast<double>(i + wide / 2) - g.centre) < 4 * g.sigma) continue;
    double seen = 0, mean = 0;
    for (std::size_t k = i; k < i + wide; ++k) {
      seen += counts[k];
      mean += expected(g, static_cast<double>(k), unused);
    }
    if (seen - mean > best.photons) best = {seen - mean, static_cast<double>(i + wide / 2)};
  }
  return best;
}

// ---- radar: fit of an echo

constexpr std::size_t near = 5;  // number of fitted bins around the peak
using Near = Eigen::Matrix<double, near, 1>;

struct EchoPlace {
  double top = 0;     // position of the peak relative to the middle bin, in bins
  Near model, power;  // expected log2 of the power, and signal-to-noise ratio, of each bin
  Near share;         // derivative of `top` with respect to the value of each bin
};

double vertex(const Near& mean) {
  return (mean[1] - mean[3]) / 2 / (mean[1] - 2 * mean[2] + mean[3] - 1e-9);
}

// Fits the amplitude and the position of the lobe by the Gauss-Newton method. Each bin is weighted
// with its power.
EchoPlace fit_lobe(const Near& mean, double log2_noise, double cells_per_bin,
                   const Window& window) {
  const Lobe lobe(window);
  EchoPlace fit;
  fit.top = vertex(mean);
  double peak = mean.maxCoeff();
  for (int step = 0; step < 50; ++step) {
    Eigen::Matrix<double, near, 2> slope;
    for (Eigen::Index i = 0; i < fit.model.size(); ++i) {
      const double u = (static_cast<double>(i) - 2 - fit.top) * cells_per_bin, d = 1e-5;
      const auto expected = [&](double log2_peak, double cells) {
        fit.power[i] = power_over_noise(log2_peak + lobe.log2_power(cells), log2_noise);
        return mean_log2_power(fit.power[i], log2_noise, window.adding);
      };
      slope(i, 0) = (expected(peak, u - d) - expected(peak, u + d)) / (2 * d) * cells_per_bin;
      slope(i, 1) = (expected(peak + d, u) - expected(peak - d, u)) / (2 * d);
      fit.model[i] = expected(peak, u);
    }
    const auto weighted = (slope.transpose() * fit.power.asDiagonal()).eval();
    const auto solver = (weighted * slope).ldlt();
    const Eigen::Vector2d move = solver.solve(weighted * (mean - fit.model));
    fit.share = solver.solve(weighted).row(0).transpose();
    fit.top = std::clamp(fit.top + std::clamp(move[0], -0.3, 0.3), -1.5, 1.5);
    peak += move[1];
    if (move.norm() < 1e-9) break;
  }
  return fit;
}

EchoPlace fit_parabola(const Near& mean) {
  EchoPlace fit;
  fit.top = vertex(mean);
  for (Eigen::Index i = 0; i < fit.share.size(); ++i) {
    constexpr double d = 1e-4;
    Near more = mean, less = mean;
    more[i] += d, less[i] -= d;
    fit.share[i] = (vertex(more) - vertex(less)) / (2 * d);
  }
  return fit;
}

// Returns the standard error of the position in bins. It combines the scatter of the frames with
// the quantisation error of the firmware's codes. Noise acts as dither and therefore reduces the
// quantisation error.
double place_error(const Profiles& frames, const Profile& profile, const EchoPlace& fit,
                   std::size_t first) {
  // Spacing of log2(power) between adjacent codes of 3, 6 or 12 antennas; it is 1/128 for 1, 2, 4
  // or 8 antennas (drivers/radar/log2_codes.hpp).
  constexpr double code_step = 1.0 / 96;
  const auto n = static_cast<double>(frames.size());
  double squares = 0, steps = 0;
  for (const auto& frame : frames) {
    const std::vector<double> levels = log2_powers(frame);
    double off = 0;
    for (std::size_t i = 0; i < near; ++i)
      off +=
          fit.share[static_cast<Eigen::Index>(i)] * (levels[first + i] - profile.mean[first + i]);
    squares += off * off;
  }
  for (std::size_t i = 0; i < near; ++i) {
    const double share = fit.share[static_cast<Eigen::Index>(i)] * code_step;
    const double dither = 2 * pi * profile.deviation[first + i] / code_step;
    steps += share * share / 12 * std::exp(-dither * dither);
  }
  return std::sqrt(squares / (n - 1) / n + steps);
}

// Returns the reason for a rejection if the shape of the lobe indicates two reflectors; otherwise
// an empty string.
std::string unlike_one_echo(const Profile& profile, const EchoPlace& fit, std::size_t top,
                            std::size_t frames) {
  constexpr double allowed = 0.66;  // tolerated deviation: 2 dB as log2 of the power
  // Bins more than 25 dB below the peak are not tested, because side lobes begin there.
  constexpr double weakest = 1 / 316.0;
  // Below this signal-to-noise power ratio, the mean log power depends on whether the amplitudes or
  // the powers of echo and noise add.
  constexpr double min_over_noise = 4;
  for (std::size_t i = 0; i < near; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double off = profile.mean[top - 2 + i] - fit.model[k];
    const double chance = 4 * profile.deviation[top - 2 + i] / std::sqrt(frames);
    if (fit.power[k] > std::max(weakest * fit.power.maxCoeff(), min_over_noise) &&
        std::abs(off) > allowed + chance)
      return format("two peaks: the echo differs by %.1f dB from that of a single reflector",
                    10 * std::log10(2.0) * std::abs(off));
  }
  return {};
}

// Returns the bin of a second peak in [low, high], or 0 if there is only one peak. A peak counts as
// a second one if it is outside the main lobe (first null at 3 cells) and at most 6 dB weaker.
std::size_t other_top(const std::vector<double>& mean, std::size_t low, std::size_t high,
                      std::size_t top, double cells_per_bin) {
  const auto width = static_cast<std::size_t>(std::ceil(3 / cells_per_bin));
  for (std::size_t i = low; i <= high; ++i)
    if ((i + width < top || i > top + width) && mean[i] > mean[i - 1] && mean[i] > mean[i + 1] &&
        mean[i] > mean[top] - 2)
      return i;
  return 0;
}

}  // namespace

Profile profile_of(const Profiles& frames) {
  const auto n = static_cast<double>(frames.size());
  const std::size_t bins = frames[0].size();
  Profile p{std::vector<double>(bins), std::vector<double>(bins), 0};
  std::vector<std::vector<double>> levels;
  for (const auto& frame : frames) levels.push_back(log2_powers(frame));
  for (const auto& level : levels)
    for (std::size_t i = 0; i < bins; ++i) p.mean[i] += level[i] / n;
  for (const auto& level : levels)
    for (std::size_t i = 0; i < bins; ++i)
      p.deviation[i] += std::pow(level[i] - p.mean[i], 2) / (n - 1);
  for (double& d : p.deviation) d = std::sqrt(d);
  p.floor = median(p.mean);
  return p;
}

std::vector<double> log2_powers(std::span<const float> power) {
  constexpr double min_share = 1e-8;
  const double strongest = power.empty() ? 0 : *std::max_element(power.begin(), power.end());
  const double floor = std::max(min_share * strongest, min_radar_power);
  std::vector<double> out;
  for (const float p : power) out.push_back(std::log2(std::max(double{p}, floor)));
  return out;
}

Peak fit_photons(std::span<const std::uint32_t> counts, double start_ps, double step_ps,
                 const Search& search) {
  Peak peak;
  const auto range_of = [&](double bin) { return (start_ps + bin * step_ps) / ps_per_m; };
  const auto bin_of = [&](double range_m) {
    return static_cast<std::size_t>(std::clamp((range_m * ps_per_m - start_ps) / step_ps, 0.0,
                                               static_cast<double>(counts.size())));
  };
  if (std::accumulate(counts.begin(), counts.end(), 0ull) < 100) {
    peak.refusal = "no peak: fewer than 100 photons received";
    return peak;
  }
  const auto wide = static_cast<std::size_t>(std::max(1.0, 200 / step_ps));
  const BinRange all{0, counts.size()};
  // Extends the window by half a pulse on each side, so that a pulse at the border of the window is
  // fitted completely.
  BinRange window{bin_of(search.distance_m - search.window_m / 2),
                  bin_of(search.distance_m + search.window_m / 2)};
  window = {window.from - std::min(window.from, wide / 2),
            std::min(window.to + wide / 2, counts.size())};
  const PhotonPeakFit fit = fit_around(counts, wide, window);
  peak.range_m = range_of(fit.peak.centre);
  peak.standard_error_m = fit.centre_error * step_ps / ps_per_m;
  peak.snr_db = 20 * std::log10(std::max(fit.snr, 1e-3));
  const SecondPeak bump = other_bump(counts, fit.peak, window);
  if (fit.snr < min_photon_snr) {
    const PhotonPeakFit strongest = fit_around(counts, wide, all);
    const double range_m = range_of(strongest.peak.centre);
    if (strongest.snr < min_photon_snr)
      peak.refusal = format("SNR too low: the strongest peak is at %.3f m", range_m);
    else
      refuse_outside(peak, range_m, delay_advice(search, range_m));
  } else if (!inside(search, peak.range_m)) {
    refuse_outside(peak, peak.range_m, delay_advice(search, peak.range_m));
  } else if (bump.photons > 0.2 * fit.peak.photons &&
             bump.photons > 5 * std::sqrt(fit.peak.photons)) {
    peak.refusal = format("two peaks: the second peak is at %.3f m", range_of(bump.bin));
  }
  return peak;
}

namespace {

std::size_t highest(const std::vector<double>& values, std::size_t first, std::size_t last) {
  const auto begin = values.begin() + static_cast<std::ptrdiff_t>(first);
  return first +
         static_cast<std::size_t>(
             std::max_element(begin, values.begin() + static_cast<std::ptrdiff_t>(last) + 1) -
             begin);
}

// Returns true if the top of the lobe is clipped: two adjacent bins have the same power in every
// frame.
bool saturated(const Profiles& frames, std::size_t top) {
  return std::all_of(frames.begin(), frames.end(), [&](const auto& f) {
    return f[top] == frames[0][top] && (f[top] == f[top - 1] || f[top] == f[top + 1]);
  });
}

}  // namespace

Peak fit_echo(const Profiles& frames, const EchoAxis& axis, const Search& search,
              const Window& window, std::size_t min_frames) {
  Peak peak;
  if (frames.size() < min_frames)
    peak.refusal = "no peak: fewer than " + std::to_string(min_frames) + " frames received";
  else if (frames[0].size() < min_bins)
    peak.refusal = "no peak: the profile has fewer than 8 bins";
  if (!peak.refusal.empty()) return peak;
  const Profile profile = profile_of(frames);
  const auto& mean = profile.mean;
  const std::size_t last = mean.size() - 3;
  const auto bin = [&](double range_m) {
    return static_cast<std::size_t>(std::clamp(std::round((range_m - axis.start_m) / axis.step_m),
                                               2.0, static_cast<double>(last)));
  };
  const auto db_over_floor = [&](std::size_t i) {
    return 10 * std::log10(2.0) * (mean[i] - profile.floor);
  };
  const std::size_t low = bin(search.distance_m - search.window_m / 2),
                    high = bin(search.distance_m + search.window_m / 2);
  std::size_t top = highest(mean, low, high);
  // Moves to the top of the lobe, which is outside the window if the lobe crosses the window's
  // border.
  while (top > 2 && mean[top - 1] > mean[top]) --top;
  while (top < last && mean[top + 1] > mean[top]) ++top;
  peak.snr_db = db_over_floor(top);
  peak.range_m = axis.range_m(static_cast<double>(top));
  if (saturated(frames, top)) {
    peak.refusal = "saturated: lower the receiver's gain in profileCfg, or move the reflector away";
    return peak;
  }
  if (peak.snr_db < min_echo_db) {
    const std::size_t strongest = highest(mean, 2, last);
    if (db_over_floor(strongest) < min_echo_db)
      peak.refusal =
          format("SNR too low: peak/median %.1f dB (at least 10 dB needed)", peak.snr_db);
    else
      refuse_outside(peak, axis.range_m(static_cast<double>(strongest)), place_advice);
    return peak;
  }
  const bool known = axis.resolution_m > 0;
  const double cells_per_bin = known ? axis.step_m / axis.resolution_m : 1;
  Near values;
  for (std::size_t i = 0; i < near; ++i) values[static_cast<Eigen::Index>(i)] = mean[top - 2 + i];
  const EchoPlace fit = known
                            ? fit_lobe(values, log2_noise_of(profile.floor), cells_per_bin, window)
                            : fit_parabola(values);
  peak.range_m = axis.range_m(static_cast<double>(top) + fit.top);
  peak.standard_error_m = axis.step_m * std::hypot(place_error(frames, profile, fit, top - 2),
                                                   known ? 0 : parabola_error);
  if (known) peak.refusal = unlike_one_echo(profile, fit, top, frames.size());
  if (const std::size_t other = other_top(mean, low, high, top, cells_per_bin))
    peak.refusal =
        format("two peaks: the second peak is at %.3f m", axis.range_m(static_cast<double>(other)));
  if (!inside(search, peak.range_m)) refuse_outside(peak, peak.range_m, place_advice);
  return peak;
}

}  // namespace echofuse::acquire
