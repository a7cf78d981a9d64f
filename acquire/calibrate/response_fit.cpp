// SPDX-License-Identifier: MIT
#include "acquire/calibrate/response_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>

#include "acquire/calibrate/echo_model.hpp"
#include "acquire/calibrate/peak.hpp"
#include "drivers/core/axis.hpp"

namespace echofuse::acquire {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
constexpr double pi = std::numbers::pi;
const double fwhm_of_sigma = std::sqrt(8 * std::numbers::ln2);

struct Fitted {
  VectorXd parameters;
  MatrixXd covariance;
  double chi2 = INFINITY;

  double error(Index k) const { return std::sqrt(std::max(covariance(k, k), 0.)); }
};

// Minimises sum w (y - f)^2 by Levenberg and Marquardt's steps with derivatives by differences. The
// weights may depend on the model. The parameters stay within their bounds.
struct Problem {
  std::function<VectorXd(const VectorXd&)> model;
  std::function<VectorXd(const VectorXd&)> weights;  // takes a model's values
  std::function<double(const VectorXd&)> chi2;       // takes a model's values
  VectorXd measured, least, most;
};

Fitted minimise(const Problem& problem, VectorXd at) {
  constexpr int steps = 100;
  const auto clamped = [&](const VectorXd& p) {
    return VectorXd(p.cwiseMax(problem.least).cwiseMin(problem.most));
  };
  at = clamped(at);
  VectorXd value = problem.model(at);
  Fitted out{at, {}, problem.chi2(value)};
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
    const VectorXd pull = weights.cwiseProduct(problem.measured - value);
    for (Index k = 0; k < at.size(); ++k)  // holds parameters at their bounds
      if (const double g = slope.col(k).dot(pull);
          (g < 0 && at[k] <= problem.least[k]) || (g > 0 && at[k] >= problem.most[k]))
        slope.col(k).setZero();
    information = slope.transpose() * weights.asDiagonal() * slope;
    const VectorXd gradient = slope.transpose() * pull;
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
  out.covariance = information.completeOrthogonalDecomposition().pseudoInverse();
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

std::string fit_impulse_response(std::span<const std::uint32_t> counts, double start_ps,
                                 double step_ps, const Search& search, record::Response& out) {
  constexpr double least_photons = 1000, least_gain = 9;
  const auto bin_of = [&](double range_m) {
    return static_cast<std::size_t>(std::clamp((range_m * ps_per_m - start_ps) / step_ps, 0.0,
                                               static_cast<double>(counts.size())));
  };
  const std::size_t from = bin_of(search.distance_m - search.window_m / 2),
                    to = bin_of(search.distance_m + search.window_m / 2);
  if (to < from + 12) return "the window has fewer than 12 bins";
  VectorXd window(static_cast<Index>(to - from));
  for (Index i = 0; i < window.size(); ++i) window[i] = counts[from + static_cast<std::size_t>(i)];
  std::vector<double> sorted(window.begin(), window.end());
  std::nth_element(sorted.begin(), sorted.begin() + std::ssize(sorted) / 4, sorted.end());
  const double floor = std::max(sorted[sorted.size() / 4], 1e-3);
  const VectorXd above = (window.array() - floor).cwiseMax(0);
  const double photons = above.sum();
  if (photons < least_photons) return "fewer than 1000 photons came";
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
  if (!best.covariance.allFinite()) return "no pulse fits the photons";
  out.irf_fwhm_ps = {fwhm_of_sigma * sigma_ps, fwhm_of_sigma * sigma_ps * best.error(log_sigma)};
  out.irf_tail_ps = {}, out.irf_tail_share = {};
  if (best.parameters.size() == 4) return {};
  const double tail_ps = std::exp(best.parameters[log_tail]) * step_ps;
  out.irf_tail_ps = {tail_ps, tail_ps * best.error(log_tail)};
  out.irf_tail_share = {best.parameters[share], best.error(share)};
  return {};
}

namespace {

// Largest value by which the window falls below 0, or rises 12 % above its middle; in units of the
// middle.
double fault_of(std::span<const double> terms) {
  const auto window = [&](double x) {
    double value = 1, k = 0;
    for (const double term : terms) value += term * std::cos(++k * x);
    return value;
  };
  double fault = 0;
  for (double x = 0; x < pi; x += 0.1)
    fault = std::max({fault, -window(x) / window(0), window(x) / window(0) - 1.12});
  return fault;
}

// Number of bins of a flank that no other echo reaches: the response is symmetric and falls.
// `side`: down (-1) or up (1) from `top`. Powers are over the peak's.
Index free_bins(const VectorXd& power, Index top, Index side, Index reach, double noise) {
  const auto at = [&](Index i) { return i >= 0 && i < power.size() ? power[i] : -1; };
  for (Index k = 1; k <= reach; ++k) {
    double most = 0;
    for (Index i = k - 1; i <= reach; ++i) most = std::max(most, at(top - side * i));
    const double here = at(top + side * k);
    if (here < 0 || here > 2 * most + 4 * noise) return k - 1;
  }
  return reach;
}

}  // namespace

WindowFit fit_radar_response(const std::vector<std::vector<std::uint16_t>>& frames,
                             const EchoAxis& axis, double range_m, record::Response& out) {
  constexpr double reach_cells = 5, least_error = 1e-3, most_off = 0.05;  // powers of the peak's
  constexpr double model_error = 0.02;  // log2: the firmware's arithmetic
  constexpr double least_gain = 9, most_misfit = 2;
  constexpr std::size_t taps = 16, least_frames = 8;
  constexpr Index most_terms = 6, least_bins = 2;
  constexpr const char* advice = "put it alone, away from the radar (with cells of 50 cm at 3 m)";
  enum : Index { place, log2_peak, adding, terms };
  if (frames.size() < least_frames) return {{}, "fewer than 8 frames came"};
  const Profile profile = profile_of(frames, axis.log2_power_step);
  const auto mean =
      Eigen::Map<const VectorXd>(profile.mean.data(), static_cast<Index>(profile.mean.size()));
  const double log2_noise = log2_noise_of(profile.floor), root = std::sqrt(frames.size()),
               cells_per_bin = axis.step_m / axis.resolution_m;
  Index top = std::clamp<Index>(std::lround(range_m / axis.step_m), 1, mean.size() - 2),
        nearest = 0;
  const double highest = mean.segment(top - 1, 3).maxCoeff(&nearest);
  top += nearest - 1;
  const double noise = std::exp2(log2_noise - highest);  // over the peak, as all powers here
  const VectorXd power = (mean.array() - highest).unaryExpr([](double v) { return std::exp2(v); });
  const auto free_of = [&](Index side) {
    return free_bins(power, top, side, std::lround(std::ceil(reach_cells / cells_per_bin)),
                     least_error + noise);
  };
  const Index first = top - free_of(-1), count = top + free_of(1) + 1 - first;
  if (std::min(top - first, first + count - 1 - top) < least_bins)
    return {{}, std::string("another echo reaches the reflector's; ") + advice};
  // Prior knowledge stands behind the bins: noise interferes (0) or adds (1), and a window has no
  // faults.
  Problem problem;
  problem.measured = VectorXd(count + 3);
  problem.measured << power.segment(first, count), 0.5, 0, 0;
  VectorXd errors(count + 3);
  for (Index i = first; i < first + count; ++i)
    errors[i - first] = std::hypot(
        least_error + noise / 10,
        std::numbers::ln2 * power[i] *
            std::hypot(model_error, profile.deviation[static_cast<std::size_t>(i)] / root));
  errors.tail(3) << 0.5, 0.05, 0.15;
  const auto window_of = [](const VectorXd& p) {
    return Window{{p.begin() + terms, p.end()}, p[adding]};
  };
  problem.model = [&](const VectorXd& p) {
    const Window window = window_of(p);
    VectorXd values(count + 3);
    for (Index i = 0; i < count; ++i) {
      const double u = (static_cast<double>(first + i) - p[place]) * cells_per_bin,
                   over = power_over_noise(p[log2_peak] + window.lobe(u), log2_noise);
      values[i] = std::exp2(mean_log2_power(over, log2_noise, window.adding) - highest);
    }
    values.tail(3) << window.adding, fault_of(window.terms),
        window.terms[1] - 1.3 * std::max(window.terms[0] - 1, 0.);
    return values;
  };
  problem.weights = [&](const VectorXd&) { return VectorXd(errors.cwiseAbs2().cwiseInverse()); };
  problem.chi2 = [&](const VectorXd& values) {
    return (problem.measured - values).cwiseQuotient(errors).squaredNorm();
  };
  const auto fit = [&](VectorXd start) {
    problem.least = VectorXd::Constant(start.size(), -0.5);
    problem.most = VectorXd::Constant(start.size(), 2.2);
    problem.least.head(terms) << static_cast<double>(top) - 1, highest - 3, 0;
    problem.most.head(terms) << static_cast<double>(top) + 1, highest + 3, 1;
    return minimise(problem, std::move(start));
  };
  Fitted best;
  for (const auto& [a, b] :
       {std::pair{0., 0.}, {0.6, -0.3}, {1., 0.}, {blackman[0], blackman[1]}, {1.9, 1.3}})
    for (const double off : {-0.3, 0., 0.3}) {
      VectorXd start(terms + 2);
      start << static_cast<double>(top) + off, highest, 0.5, a, b;
      if (Fitted f = fit(start); f.chi2 < best.chi2) best = std::move(f);
    }
  for (Fitted last; best.chi2 < last.chi2 - least_gain;) {
    last = best;
    for (const double term : {0., 0.3}) {
      VectorXd start(last.parameters.size() + 1);
      start << last.parameters, term;
      if (start.size() > std::min(terms + most_terms, count - 2)) break;
      if (Fitted f = fit(start); f.chi2 < best.chi2 - least_gain) best = std::move(f);
    }
  }
  const VectorXd off = (problem.measured - problem.model(best.parameters)).cwiseAbs() - 4 * errors;
  if (!(off.head(count).maxCoeff() < most_off))
    return {{}, std::string("the echo is not that of one point; ") + advice};
  const Window window = window_of(best.parameters);
  const double misfit =
      std::max(1., best.chi2 / static_cast<double>(count + 3 - best.parameters.size()));
  out.radar = {axis.resolution_m, {}};
  double greatest = 0;
  for (std::size_t k = 0; k < taps; ++k) {
    const double u = static_cast<double>(k) / record::RadarResponse::taps_a_cell,
                 amplitude = window_amplitude(u, window.terms);
    out.radar.taps.push_back(amplitude * amplitude);
    VectorXd slope = VectorXd::Zero(best.parameters.size());
    for (Index j = terms; j < slope.size(); ++j)
      slope[j] = 2 * amplitude * term_amplitude(u, static_cast<double>(j - terms + 1));
    greatest = std::max(greatest, slope.dot(best.covariance * slope));
  }
  out.taps_standard_error = std::sqrt(greatest * misfit);
  return {misfit < most_misfit ? window : Window{}, {}};
}

std::string fit_noise_exponent(const std::vector<std::vector<std::uint16_t>>& frames,
                               double log2_power_step, record::Response& out) {
  constexpr std::size_t least_frames = 40, least_means = 8;
  if (frames.size() < least_frames) return "fewer than 40 frames came";
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
      std::vector<double> means(frames.size() / length);
      for (std::size_t i = 0; i < means.size() * length; ++i)
        means[i / length] += powers[i] / static_cast<double>(length);
      if (const double noise = spread_of(means); noise > 0)
        x.push_back(std::log(static_cast<double>(length))), y.push_back(std::log(noise));
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
  if (exponents.size() < 3) return "the frames are all alike";
  const auto n = static_cast<double>(exponents.size());
  const double mean = std::accumulate(exponents.begin(), exponents.end(), 0.0) / n;
  out.radar_noise_exponent = {std::min(mean, -1e-3), spread_of(exponents) / std::sqrt(n)};
  return {};
}

}  // namespace echofuse::acquire
