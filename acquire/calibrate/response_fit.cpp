// SPDX-License-Identifier: MIT
#include "acquire/calibrate/response_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

#include "acquire/calibrate/echo_model.hpp"
#include "drivers/core/axis.hpp"

namespace echofuse::acquire {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double pi = std::numbers::pi;
const double fwhm_of_sigma = std::sqrt(8 * std::numbers::ln2);

struct Fitted {
  VectorXd parameters, standard_errors;
  double chi2 = INFINITY;
};

// Minimises sum w (y - f)^2 by Levenberg and Marquardt's steps with derivatives by differences. The
// weights may depend on the model. The parameters stay within their bounds.
struct Problem {
  std::function<VectorXd(const VectorXd&)> model;
  std::function<VectorXd(const VectorXd&)> weights;  // of a model's values
  std::function<double(const VectorXd&)> chi2;       // of a model's values
  VectorXd measured, least, most;
};

Fitted minimise(const Problem& problem, VectorXd at) {
  constexpr int steps = 100;
  const auto clamped = [&](const VectorXd& p) {
    return VectorXd(p.cwiseMax(problem.least).cwiseMin(problem.most));
  };
  at = clamped(at);
  VectorXd value = problem.model(at);
  Fitted out{at, VectorXd::Constant(at.size(), INFINITY), problem.chi2(value)};
  double damping = 1e-3;
  MatrixXd information;
  for (int step = 0; step < steps && damping < 1e9; ++step) {
    MatrixXd slope(value.size(), at.size());
    for (Index k = 0; k < at.size(); ++k) {
      VectorXd moved = at;
      const double d = 1e-5 * std::max(1.0, std::abs(at[k]));
      moved[k] += d;
      slope.col(k) = (problem.model(moved) - value) / d;
    }
    const VectorXd weights = problem.weights(value);
    information = slope.transpose() * weights.asDiagonal() * slope;
    const VectorXd gradient = slope.transpose() * weights.cwiseProduct(problem.measured - value);
    MatrixXd damped = information;
    damped.diagonal() *= 1 + damping;
    damped.diagonal().array() += 1e-12;
    const VectorXd next = clamped(at + damped.ldlt().solve(gradient));
    const VectorXd next_value = problem.model(next);
    const double chi2 = problem.chi2(next_value);
    if (!(chi2 <= out.chi2)) {
      damping *= 10;
      continue;
    }
    const bool done = out.chi2 - chi2 < 1e-9 * (1 + chi2);
    at = next, value = next_value, out.chi2 = chi2, damping = std::max(damping / 10, 1e-9);
    if (done) break;
  }
  out.parameters = at;
  // A value that nothing depends on, as an even background of no counts, has no error.
  const MatrixXd covariance = information.completeOrthogonalDecomposition().pseudoInverse();
  out.standard_errors = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  return out;
}

// ---- SPD

double normal(double u) { return 0.5 * std::erfc(-u / std::numbers::sqrt2); }

// The share of the photons before time t, in units of the Gaussian's deviation, of a Gaussian with
// an exponential tail of this time constant.
double before(double t, double tail) {
  if (tail < 0.05) return normal(t - tail);
  return normal(t) - std::exp(0.5 / (tail * tail) - t / tail) * normal(t - 1 / tail);
}

enum Parameter : Index { centre, log_sigma, log_photons, log_floor, share, log_tail };  // in bins

VectorXd expected_counts(const VectorXd& p, Index bins) {
  const double sigma = std::exp(p[log_sigma]), photons = std::exp(p[log_photons]);
  const bool with_tail = p.size() > share;
  const double tail = with_tail ? std::exp(p[log_tail]) / sigma : 0,
               of_tail = with_tail ? p[share] : 0;
  const auto up_to = [&](double bin) {
    const double t = (bin - p[centre]) / sigma;
    return (1 - of_tail) * normal(t) + (of_tail > 0 ? of_tail * before(t, tail) : 0);
  };
  VectorXd out(bins);
  double last = up_to(0);
  for (Index i = 0; i < bins; ++i) {
    const double next = up_to(static_cast<double>(i + 1));
    out[i] = std::max(photons * (next - last), 0.) + std::exp(p[log_floor]);
    last = next;
  }
  return out;
}

Fitted fit_counts(const VectorXd& counts, VectorXd start) {
  const Index bins = counts.size(), size = start.size();
  Problem problem;
  problem.measured = counts;
  problem.model = [bins](const VectorXd& p) { return expected_counts(p, bins); };
  problem.weights = [](const VectorXd& mean) { return VectorXd(mean.cwiseInverse()); };
  problem.chi2 = [&counts](const VectorXd& mean) {  // the deviance
    double sum = 0;
    for (Index i = 0; i < mean.size(); ++i)
      sum += 2 * (mean[i] - counts[i] +
                  (counts[i] > 0 ? counts[i] * std::log(counts[i] / mean[i]) : 0));
    return sum;
  };
  const auto widest = std::log(static_cast<double>(bins));
  problem.least = VectorXd(6), problem.most = VectorXd(6);
  problem.least << 0, -1, 0, -12, 0, -1;
  problem.most << static_cast<double>(bins), widest, 30, 20, 1, widest;
  problem.least.conservativeResize(size), problem.most.conservativeResize(size);
  return minimise(problem, std::move(start));
}

}  // namespace

void fit_impulse_response(std::span<const std::uint32_t> counts, double start_ps, double step_ps,
                          const Search& search, record::Response& out) {
  constexpr double least_photons = 1000, least_gain = 9;
  const auto bin_of = [&](double range_m) {
    return static_cast<std::size_t>(std::clamp((range_m * ps_per_m - start_ps) / step_ps, 0.0,
                                               static_cast<double>(counts.size())));
  };
  const std::size_t from = bin_of(search.distance_m - search.window_m / 2),
                    to = bin_of(search.distance_m + search.window_m / 2);
  if (to < from + 12) return;
  VectorXd window(static_cast<Index>(to - from));
  for (Index i = 0; i < window.size(); ++i) window[i] = counts[from + static_cast<std::size_t>(i)];
  std::vector<double> sorted(window.begin(), window.end());
  std::nth_element(sorted.begin(), sorted.begin() + std::ssize(sorted) / 4, sorted.end());
  const double floor = std::max(sorted[sorted.size() / 4], 1e-3);
  const VectorXd above = (window.array() - floor).cwiseMax(0);
  const double photons = above.sum();
  if (photons < least_photons) return;
  Index top = 0;
  const double highest = above.maxCoeff(&top);
  VectorXd start(4);
  start << static_cast<double>(top) + 0.5,
      std::log(std::max(photons / highest / std::sqrt(2 * pi), 0.5)), std::log(photons),
      std::log(floor);
  Fitted best = fit_counts(window, start);
  for (const double tail : {0.5, 2.}) {
    VectorXd with_tail(6);
    with_tail << best.parameters.head(4), 0.3, best.parameters[log_sigma] + std::log(tail);
    if (Fitted f = fit_counts(window, with_tail); f.chi2 < best.chi2 - least_gain)
      best = std::move(f);
  }
  const double sigma_ps = std::exp(best.parameters[log_sigma]) * step_ps;
  if (!best.standard_errors.allFinite()) return;
  out.irf_fwhm_ps = {fwhm_of_sigma * sigma_ps,
                     fwhm_of_sigma * sigma_ps * best.standard_errors[log_sigma]};
  out.irf_tail_ps = {}, out.irf_tail_share = {};
  if (best.parameters.size() == 4) return;
  const double tail_ps = std::exp(best.parameters[log_tail]) * step_ps;
  out.irf_tail_ps = {tail_ps, tail_ps * best.standard_errors[log_tail]};
  out.irf_tail_share = {best.parameters[share], best.standard_errors[share]};
}

void fit_radar_response(const std::vector<std::vector<std::uint16_t>>& frames, const EchoAxis& axis,
                        double range_m, record::Response& out) {
  constexpr double reach_cells = 3, most_off = 0.33;  // 1 dB in log2 of the power
  constexpr double model_error = 0.02;                // log2: the firmware's arithmetic
  constexpr std::size_t taps = 16;
  const auto bins = static_cast<Index>(frames.at(0).size());
  const auto n = static_cast<double>(frames.size());
  const double cells_per_bin = axis.step_m / axis.resolution_m, middle = range_m / axis.step_m;
  const auto reach = static_cast<Index>(std::ceil(reach_cells / cells_per_bin));
  const Index first = std::max<Index>(static_cast<Index>(std::lround(middle)) - reach, 0);
  const Index count = std::min(bins, static_cast<Index>(std::lround(middle)) + reach + 1) - first;
  if (count < 6) return;
  VectorXd mean = VectorXd::Zero(bins), squares = VectorXd::Zero(bins);
  for (const auto& frame : frames)
    for (Index i = 0; i < bins; ++i) {
      const double v = frame[static_cast<std::size_t>(i)] * axis.log2_power_step;
      mean[i] += v / n, squares[i] += v * v / n;
    }
  std::vector<double> sorted(mean.begin(), mean.end());
  std::nth_element(sorted.begin(), sorted.begin() + std::ssize(sorted) / 2, sorted.end());
  const double log2_noise = log2_noise_of(sorted[sorted.size() / 2]);
  const VectorXd variance =
      ((squares - mean.cwiseProduct(mean)).cwiseMax(0).segment(first, count) / n).array() +
      model_error * model_error;
  Problem problem;
  problem.measured = mean.segment(first, count);
  // Place (bins) | amplitude (log2 of the power) | the window's two terms.
  problem.model = [&](const VectorXd& p) {
    VectorXd values(count);
    for (Index i = 0; i < count; ++i) {
      const double u = (static_cast<double>(first + i) - p[0]) * cells_per_bin;
      const double signal =
          p[1] + 2 * std::log2(std::max(std::abs(window_amplitude(u, p[2], p[3])), 1e-6));
      values[i] = mean_log2_power(power_over_noise(signal, log2_noise), log2_noise);
    }
    return values;
  };
  problem.weights = [&](const VectorXd&) { return VectorXd(variance.cwiseInverse()); };
  problem.chi2 = [&](const VectorXd& values) {
    return (problem.measured - values).cwiseAbs2().cwiseQuotient(variance).sum();
  };
  problem.least = VectorXd(4), problem.most = VectorXd(4);
  problem.least << middle - 1, problem.measured.maxCoeff() - 3, -0.1, -0.1;
  problem.most << middle + 1, problem.measured.maxCoeff() + 3, 1.5, 0.5;
  Fitted best;
  for (const auto& [a, b] : {std::pair{0., 0.}, {0.85, 0.}, {1., 0.}, {blackman_a, blackman_b}}) {
    VectorXd start(4);
    start << middle, problem.measured.maxCoeff(), a, b;
    if (Fitted f = minimise(problem, start); f.chi2 < best.chi2) best = std::move(f);
  }
  if (!best.standard_errors.allFinite()) return;
  const VectorXd off = problem.measured - problem.model(best.parameters);
  for (Index i = 0; i < count; ++i)
    if (std::abs(off[i]) > most_off + 4 * std::sqrt(variance[i])) return;
  out.radar = {axis.resolution_m, {}};
  const double a = best.parameters[2], b = best.parameters[3], d = 1e-4;
  double greatest = 0;
  for (std::size_t k = 0; k < taps; ++k) {
    const double u = static_cast<double>(k) / record::RadarResponse::taps_a_cell;
    const auto power = [u](double x, double y) { return std::pow(window_amplitude(u, x, y), 2); };
    out.radar.taps.push_back(power(a, b));
    greatest = std::max(greatest,
                        std::hypot((power(a + d, b) - power(a, b)) / d * best.standard_errors[2],
                                   (power(a, b + d) - power(a, b)) / d * best.standard_errors[3]));
  }
  out.taps_standard_error = greatest;
}

void fit_noise_exponent(const std::vector<std::vector<std::uint16_t>>& frames,
                        double log2_power_step, record::Response& out) {
  constexpr std::size_t least_frames = 40, least_means = 8;
  if (frames.size() < least_frames) return;
  const std::size_t bins = frames[0].size();
  std::vector<double> level(bins);
  for (const auto& frame : frames)
    for (std::size_t i = 0; i < bins; ++i) level[i] += frame[i];
  std::vector<std::size_t> order(bins);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return level[a] < level[b]; });
  order.resize(bins / 2);
  std::vector<double> exponents;
  for (const std::size_t bin : order) {
    std::vector<double> powers, x, y;
    for (const auto& frame : frames) powers.push_back(std::exp2(frame[bin] * log2_power_step));
    for (std::size_t length = 1; frames.size() / length >= least_means; length *= 2) {
      double sum = 0, squares = 0;
      const std::size_t means = frames.size() / length;
      for (std::size_t k = 0; k < means; ++k) {
        double mean = 0;
        for (std::size_t i = 0; i < length; ++i)
          mean += powers[k * length + i] / static_cast<double>(length);
        sum += mean, squares += mean * mean;
      }
      const auto n = static_cast<double>(means);
      const double variance = (squares - sum * sum / n) / (n - 1);
      if (variance > 0)
        x.push_back(std::log(static_cast<double>(length))), y.push_back(std::log(variance) / 2);
    }
    if (x.size() < 3) continue;
    const auto n = static_cast<double>(x.size());
    const double mx = std::accumulate(x.begin(), x.end(), 0.0) / n,
                 my = std::accumulate(y.begin(), y.end(), 0.0) / n;
    double xy = 0, xx = 0;
    for (std::size_t i = 0; i < x.size(); ++i)
      xy += (x[i] - mx) * (y[i] - my), xx += (x[i] - mx) * (x[i] - mx);
    exponents.push_back(xy / xx);
  }
  if (exponents.size() < 3) return;
  const auto n = static_cast<double>(exponents.size());
  const double mean = std::accumulate(exponents.begin(), exponents.end(), 0.0) / n;
  double squares = 0;
  for (const double e : exponents) squares += (e - mean) * (e - mean);
  out.radar_noise_exponent = {std::min(mean, -1e-3), std::sqrt(squares / (n - 1) / n)};
}

}  // namespace echofuse::acquire
