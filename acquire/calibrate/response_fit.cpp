// SPDX-License-Identifier: MIT
#include "acquire/calibrate/response_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <utility>

#include "acquire/calibrate/echo_model.hpp"
#include "acquire/calibrate/peak.hpp"
#include "drivers/core/axis.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::acquire {
namespace {

using Eigen::Index, Eigen::MatrixXd, Eigen::VectorXd;
using record::fwhm_of_sigma;
constexpr double pi = std::numbers::pi;

struct Fitted {
  VectorXd parameters;
  MatrixXd covariance;
  double chi2 = INFINITY;

  double error(Index k) const { return std::sqrt(std::max(covariance(k, k), 0.)); }
};

// Weighted least-squares problem: minimise() minimises sum w (y - f)^2 by Levenberg-Marquardt with
// numerical derivatives and bounded parameters. The weights may depend on the model.
struct Problem {
  std::function<VectorXd(const VectorXd&)> model;
  std::function<VectorXd(const VectorXd&)> weights;
  std::function<double(const VectorXd&)> chi2;
  VectorXd measured, lower, upper;
};

Fitted minimise(const Problem& problem, VectorXd at) {
  constexpr int steps = 100;
  const auto clamped = [&](const VectorXd& p) {
    return VectorXd(p.cwiseMax(problem.lower).cwiseMin(problem.upper));
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
    for (Index k = 0; k < at.size();
         ++k)  // holds parameters at a bound if the step would exceed it
      if (const double g = slope.col(k).dot(pull);
          (g < 0 && at[k] <= problem.lower[k]) || (g > 0 && at[k] >= problem.upper[k]))
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
  // A parameter that the data do not constrain gets a standard error of 0 from the pseudo-inverse.
  out.covariance = information.completeOrthogonalDecomposition().pseudoInverse();
  return out;
}

// ---- SPD: fit of the impulse response

double normal(double u) { return 0.5 * std::erfc(-u / std::numbers::sqrt2); }

// Returns the cumulative probability at time t for a Gaussian with an exponential tail. Times are
// in units of the standard deviation of the Gaussian.
double before(double t, double tail) {
  if (tail < 0.05) return normal(t - tail);
  return normal(t) - std::exp(0.5 / (tail * tail) - t / tail) * normal(t - 1 / tail);
}

// The time parameters are in units of bins.
enum Parameter : Index { centre, log_sigma, log_photons, log_floor, share, log_tail };

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
  problem.chi2 = [&counts](const VectorXd& mean) {  // Poisson deviance
    double sum = 0;
    for (Index i = 0; i < mean.size(); ++i)
      sum += 2 * (mean[i] - counts[i] +
                  (counts[i] > 0 ? counts[i] * std::log(counts[i] / mean[i]) : 0));
    return sum;
  };
  const auto widest = std::log(static_cast<double>(bins));
  problem.lower = VectorXd(6), problem.upper = VectorXd(6);
  problem.lower << 0, -1, 0, -12, 0, -1;
  problem.upper << static_cast<double>(bins), widest, 30, 20, 1, widest;
  problem.lower.conservativeResize(size), problem.upper.conservativeResize(size);
  return minimise(problem, std::move(start));
}

}  // namespace

std::string fit_impulse_response(std::span<const std::uint32_t> counts, double start_ps,
                                 double step_ps, const Search& search, record::Response& out) {
  constexpr double min_photons = 1000, min_gain = 9;
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
  if (photons < min_photons) return "fewer than 1000 photons received";
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
    if (Fitted f = fit_counts(window, with_tail); f.chi2 < best.chi2 - min_gain)
      best = std::move(f);
  }
  const double sigma_ps = std::exp(best.parameters[log_sigma]) * step_ps;
  if (!best.covariance.allFinite()) return "the fit of the pulse did not converge";
  out.irf_fwhm_ps = {fwhm_of_sigma * sigma_ps, fwhm_of_sigma * sigma_ps * best.error(log_sigma)};
  out.irf_tail_ps = {}, out.irf_tail_share = {};
  if (best.parameters.size() == 4) return {};
  const double tail_ps = std::exp(best.parameters[log_tail]) * step_ps;
  out.irf_tail_ps = {tail_ps, tail_ps * best.error(log_tail)};
  out.irf_tail_share = {best.parameters[share], best.error(share)};
  return {};
}

namespace {

// Returns by how much the window function falls below 0 or exceeds 112 % of its value at the
// centre, as a fraction of that value.
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

// Returns the number of bins in a flank that contain no second echo. The response is assumed to be
// symmetric and decreasing. `side` selects the flank below (-1) or above (1) `top`. Powers are
// relative to the peak.
Index free_bins(const VectorXd& power, Index top, Index side, Index reach, double noise) {
  const auto at = [&](Index i) { return i >= 0 && i < power.size() ? power[i] : -1; };
  for (Index k = 1; k <= reach; ++k) {
    double maximum = 0;
    for (Index i = k - 1; i <= reach; ++i) maximum = std::max(maximum, at(top - side * i));
    const double here = at(top + side * k);
    if (here < 0 || here > 3 * maximum + 4 * noise) return k - 1;
  }
  return reach;
}

}  // namespace

namespace {

class EchoFit {
 public:
  // Indices of the parameters; `place` is in bins.
  enum : Index { place, log2_peak, adding, skew, terms };
  static constexpr double max_misfit = 2;  // maximum chi2 per degree of freedom of a good fit

  EchoFit(const Profile& profile, const EchoAxis& axis, std::size_t frames, double range_m)
      : cells_per_bin_(axis.step_m / axis.resolution_m), log2_noise_(log2_noise_of(profile.floor)) {
    const auto mean =
        Eigen::Map<const VectorXd>(profile.mean.data(), static_cast<Index>(profile.mean.size()));
    top_ = std::clamp<Index>(std::lround(range_m / axis.step_m), 1, mean.size() - 2);
    Index nearest = 0;
    highest_ = mean.segment(top_ - 1, 3).maxCoeff(&nearest);
    top_ += nearest - 1;
    // Power of each bin relative to the peak.
    const VectorXd power =
        (mean.array() - highest_).unaryExpr([](double v) { return std::exp2(v); });
    const double noise = std::exp2(log2_noise_ - highest_);
    const auto free_of = [&](Index side) {
      return free_bins(power, top_, side, std::lround(std::ceil(reach_cells / cells_per_bin_)),
                       min_error + noise);
    };
    first_ = top_ - free_of(-1), count_ = top_ + free_of(1) + 1 - first_;
    // The three elements after the bins are priors. They keep `adding` between 0 and 1, and the
    // window within its bounds.
    problem_.measured = VectorXd(count_ + 3);
    problem_.measured << power.segment(first_, count_), 0.5, 0, 0;
    errors_ = VectorXd(count_ + 3);
    for (Index i = 0; i < count_; ++i) {
      const auto bin = static_cast<std::size_t>(first_ + i);
      const double log2_error = std::hypot(model_error, profile.deviation[bin] / std::sqrt(frames));
      errors_[i] =
          std::hypot(min_error + noise / 10, std::numbers::ln2 * power[first_ + i] * log2_error);
    }
    errors_.tail(3) << 0.5, 0.05, 0.15;
    problem_.model = [this](const VectorXd& p) { return values(p); };
    problem_.weights = [this](const VectorXd&) {
      return VectorXd(errors_.cwiseAbs2().cwiseInverse());
    };
    problem_.chi2 = [this](const VectorXd& v) {
      return (problem_.measured - v).cwiseQuotient(errors_).squaredNorm();
    };
  }
  EchoFit(const EchoFit&) = delete;
  EchoFit& operator=(const EchoFit&) = delete;

  // Returns false if a flank has too few bins that are free of a second echo.
  bool enough() const {
    constexpr Index min_bins = 2;
    return std::min(top_ - first_, first_ + count_ - 1 - top_) >= min_bins;
  }
  // Fits windows with and without a phase error. Each additional parameter must reduce chi2 by more
  // than `min_gain`. A phase error is rejected if the fit is poor, because two echoes rarely fit
  // a single window well.
  void fit() {
    constexpr std::pair<double, double> shapes[] = {
        {0, 0}, {1, 0}, {blackman[0], blackman[1]}, {0.6, -0.3}, {1.9, 1.3}};
    for (const auto& [a, b] : shapes)
      for (const double off : {-0.3, 0., 0.3}) try_from(start_of(off, 0, a, b));
    add_terms();
    const Fitted even = std::exchange(best, {});
    for (const auto& [a, b] : std::span(shapes).first(3))
      for (const double rad : {1.5, 4., 8.})
        for (const double side : {-1., 1.}) try_from(start_of(0, side * rad, a, b));
    add_terms();
    // The assumed error of the firmware's arithmetic is an upper bound. If the points scatter less,
    // a smaller reduction of chi2 is significant.
    const double gain = min_gain * std::clamp(scatter(), 0.5, 1.);
    if (misfit() > max_misfit || cost_of(even, gain) <= cost_of(best, gain) + gain) best = even;
  }
  bool of_one_point() const {
    constexpr double max_off = 0.05;
    const VectorXd off =
        (problem_.measured - problem_.model(best.parameters)).cwiseAbs() - 4 * errors_;
    return off.head(count_).maxCoeff() < max_off;
  }
  double misfit() const { return std::max(1., scatter()); }
  static Window window_of(const VectorXd& p) {
    return {{p.begin() + terms, p.end()}, p[adding], p[skew]};
  }

  Fitted best;

 private:
  // chi2 per degree of freedom
  double scatter() const {
    return best.chi2 / static_cast<double>(count_ + 3 - best.parameters.size());
  }

  static constexpr double reach_cells = 5, min_error = 1e-3, min_gain = 9;
  // Error of the firmware's arithmetic, as log2 of the power.
  static constexpr double model_error = 0.02;
  static constexpr Index max_terms = 6;

  VectorXd values(const VectorXd& p) const {
    const Window window = window_of(p);
    const Lobe lobe(window);
    VectorXd out(count_ + 3);
    for (Index i = 0; i < count_; ++i) {
      const double u = (static_cast<double>(first_ + i) - p[place]) * cells_per_bin_,
                   over = power_over_noise(p[log2_peak] + lobe.log2_power(u), log2_noise_);
      out[i] = std::exp2(mean_log2_power(over, log2_noise_, window.adding) - highest_);
    }
    out.tail(3) << window.adding, fault_of(window.terms),
        window.terms[1] - 1.3 * std::max(window.terms[0] - 1, 0.);
    return out;
  }
  VectorXd start_of(double off, double rad, double a, double b) const {
    VectorXd out(terms + 2);
    out << static_cast<double>(top_) + off, highest_, 0.5, rad, a, b;
    return out;
  }
  static double cost_of(const Fitted& f, double gain = min_gain) {
    return f.chi2 + gain * static_cast<double>(f.parameters.size());
  }
  void try_from(VectorXd start) {
    constexpr double max_rad = 12;
    problem_.lower = VectorXd::Constant(start.size(), -0.5);
    problem_.upper = VectorXd::Constant(start.size(), 2.2);
    const double rad = start[skew] == 0 ? 0 : max_rad, at = static_cast<double>(top_);
    problem_.lower.head(terms) << at - 1, highest_ - 3, 0, -rad;
    problem_.upper.head(terms) << at + 1, highest_ + 3, 1, rad;
    if (Fitted f = minimise(problem_, std::move(start)); cost_of(f) < cost_of(best))
      best = std::move(f);
  }
  void add_terms() {
    const Index max_size = std::min(terms + max_terms, count_ - 2);
    for (Index size = 0; size < best.parameters.size() && best.parameters.size() < max_size;) {
      const VectorXd last = best.parameters;
      size = last.size() + 1;
      for (const double term : {0., 0.3}) {
        VectorXd start(size);
        start << last, term;
        try_from(std::move(start));
      }
    }
  }

  double cells_per_bin_, log2_noise_, highest_ = 0;
  Index top_ = 0, first_ = 0, count_ = 0;
  VectorXd errors_;
  Problem problem_;
};

constexpr Index flank_taps = 15;

// Returns the position of the peak of a lobe, in cells from the transform's origin.
double peak_of(const Lobe& lobe) {
  constexpr double step = 1. / 32;
  double top = 0;
  for (double u = -1; u <= 1; u += step)
    if (lobe.power(u) > lobe.power(top)) top = u;
  const double before = lobe.power(top - step), behind = lobe.power(top + step);
  // Vertex of the parabola through the maximum and its neighbours.
  return top + step * (before - behind) / 2 / (before - 2 * lobe.power(top) + behind);
}

// Returns the taps beyond the peak and those before it, then the peak and the largest difference
// between the flanks.
VectorXd shape_of(const Window& window) {
  const Lobe lobe(window);
  const double peak = window.skew_rad == 0 ? 0 : peak_of(lobe), peak_power = lobe.power(peak);
  VectorXd out(2 * flank_taps + 2);
  for (Index k = 0; k < flank_taps; ++k) {
    const double u = static_cast<double>(k + 1) / record::RadarResponse::taps_a_cell;
    out[k] = lobe.power(peak + u) / peak_power,
    out[flank_taps + k] = lobe.power(peak - u) / peak_power;
  }
  const VectorXd odd = out.head(flank_taps) - out.segment(flank_taps, flank_taps);
  Index largest = 0;
  odd.cwiseAbs().maxCoeff(&largest);
  out.tail(2) << peak, odd[largest];
  return out;
}

// Returns the standard errors of the shape. The caller increases them if the fit is poor.
VectorXd shape_errors(const Fitted& fit, const VectorXd& shape) {
  constexpr double d = 1e-3;
  MatrixXd slope = MatrixXd::Zero(shape.size(), fit.parameters.size());
  for (Index j = EchoFit::skew; j < fit.parameters.size(); ++j) {
    VectorXd moved = fit.parameters;
    if (j == EchoFit::skew && moved[j] == 0) continue;
    moved[j] += d;
    slope.col(j) = (shape_of(EchoFit::window_of(moved)) - shape) / d;
  }
  return (slope * fit.covariance * slope.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
}

constexpr double lobe_cells = 3;  // half width of the main lobe of a Blackman window

// Returns the range from which on an echo does not overlap the transmitter leakage at range zero.
double min_range_m(const EchoAxis& axis) { return 2 * lobe_cells * axis.resolution_m; }

// Returns whether the transmitter leakage overlaps the echo at `range_m`: the echo is too near, and
// a nearer bin outside its own main lobe has more than twice the median power.
bool leakage_overlaps(const Profile& profile, const EchoAxis& axis, double range_m) {
  constexpr double log2_of_two = 1;
  if (range_m >= min_range_m(axis)) return false;
  const double free_m = range_m - lobe_cells * axis.resolution_m;
  const auto bins = static_cast<std::ptrdiff_t>((free_m - axis.start_m) / axis.step_m) + 1;
  return bins < 1 || *std::max_element(profile.mean.begin(), profile.mean.begin() + bins) >
                         profile.floor + log2_of_two;
}

}  // namespace

WindowFit fit_radar_response(const Profiles& frames, const EchoAxis& axis, double range_m,
                             record::Response& out) {
  constexpr std::size_t min_frames = 8;
  const std::string advice = format(
      "; remove other objects and place the reflector at %.1f m or farther, because the range "
      "cells of this cfg have %.0f cm, or use a cfg with shorter range cells",
      min_range_m(axis), 100 * axis.resolution_m);
  if (frames.size() < min_frames) return {{}, "fewer than 8 frames received"};
  const Profile profile = profile_of(frames);
  if (leakage_overlaps(profile, axis, range_m))
    return {{}, "transmitter leakage overlaps the reflector's echo" + advice};
  EchoFit echo(profile, axis, frames.size(), range_m);
  if (!echo.enough()) return {{}, "another echo overlaps the reflector's echo" + advice};
  echo.fit();
  if (!echo.of_one_point())
    return {{}, "the echo does not match that of a single point target" + advice};
  WindowFit found{EchoFit::window_of(echo.best.parameters), {}};
  const VectorXd shape = shape_of(found.window),
                 errors = std::sqrt(echo.misfit()) * shape_errors(echo.best, shape);
  constexpr Index taps = 2 * flank_taps;
  out.radar = {axis.resolution_m, {}};
  std::vector<double>& response = out.radar.taps;
  if (found.window.skew_rad != 0)
    for (Index k = taps; k-- > flank_taps;) response.push_back(shape[k]);
  response.push_back(1);
  response.insert(response.end(), shape.begin(), shape.begin() + flank_taps);
  out.taps_standard_error = errors.head(taps).maxCoeff();
  found.window.zero_cells = shape[taps];
  found.zero_error_m = errors[taps] * axis.resolution_m;
  found.lopsided = {shape[taps + 1], errors[taps + 1]};
  if (echo.misfit() > EchoFit::max_misfit) found.window = {};
  return found;
}

std::string fit_noise_exponent(const Profiles& frames, record::Response& out) {
  constexpr std::size_t min_frames = 40, min_means = 8;
  if (frames.size() < min_frames) return "fewer than 40 frames received";
  const std::size_t bins = frames[0].size();
  const std::vector<double> level = profile_of(frames).mean;
  std::vector<std::size_t> order(bins);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return level[a] < level[b]; });
  order.resize(bins / 2);
  std::vector<double> exponents;
  for (const std::size_t bin : order) {
    std::vector<double> powers, x, y;
    for (const auto& frame : frames) powers.push_back(double{frame[bin]});
    for (std::size_t length = 1; frames.size() / length >= min_means; length *= 2) {
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
  if (exponents.size() < 3) return "all frames are identical";
  const auto n = static_cast<double>(exponents.size());
  const double mean = std::accumulate(exponents.begin(), exponents.end(), 0.0) / n;
  out.radar_noise_exponent = {std::min(mean, -1e-3), spread_of(exponents) / std::sqrt(n)};
  return {};
}

}  // namespace echofuse::acquire
