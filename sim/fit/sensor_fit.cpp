// SPDX-License-Identifier: MIT
#include "sim/fit/sensor_fit.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim/sensors/radar_echo.hpp"

namespace echofuse::sim {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

double length_of(double x, double y, double z) { return std::sqrt(x * x + y * y + z * z); }

// Normal equations with a whisper of a ridge, so that no column is needed.
VectorXd least_squares(const MatrixXd& columns, const VectorXd& y) {
  MatrixXd a = columns.transpose() * columns;
  a.diagonal().array() += 1e-9 * std::max(1e-300, a.diagonal().maxCoeff());
  return a.ldlt().solve(columns.transpose() * y);
}

// Counts by bin of the patches of one kind.
VectorXd histogram_of(const Surface& surface, Zone zone, const Conditions& c) {
  VectorXd out = VectorXd::Zero(c.bins);
  for (const SurfacePatch& p : surface.patches) {
    if (p.zone != zone) continue;
    const double range = length_of(p.x, p.y, p.z);
    const double place = (ps_per_m * range - c.first_bin_ps) / c.bin_width_ps - 0.5;
    const auto i = static_cast<Eigen::Index>(std::floor(place));
    if (i < 0 || i + 1 >= c.bins) continue;
    const double rest = place - static_cast<double>(i), w = p.weight / (range * range);
    out[i] += (1 - rest) * w;
    out[i + 1] += rest * w;
  }
  return out;
}

// A Gaussian about `delay_ps`, and of `tail_share` of it an exponential tail.
VectorXd responded(const VectorXd& v, double bin_ps, const ResponseFit::Response& r) {
  const double sigma = std::max(0.3, r.sigma_ps / bin_ps), delay = r.delay_ps / bin_ps;
  const auto reach = static_cast<Eigen::Index>(std::ceil(4 * sigma + std::abs(delay)));
  VectorXd kernel(2 * reach + 1), out = VectorXd::Zero(v.size());
  for (Eigen::Index k = -reach; k <= reach; ++k)
    kernel[k + reach] = std::exp(-0.5 * std::pow((static_cast<double>(k) - delay) / sigma, 2));
  kernel /= kernel.sum();
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    if (v[i] == 0) continue;
    const Eigen::Index from = std::max<Eigen::Index>(0, i - reach);
    const Eigen::Index to = std::min<Eigen::Index>(v.size() - 1, i + reach);
    out.segment(from, to - from + 1) += v[i] * kernel.segment(from - i + reach, to - from + 1);
  }
  if (r.tail_share == 0) return out;
  // Half of a bin's light decays from its middle on, so to say: the mean delay is that of the tail.
  const double keep = std::exp(-bin_ps / 150);
  double late = 0, before = 0;
  for (Eigen::Index i = 0; i < v.size(); ++i) {
    late = keep * late + (1 - keep) * (out[i] + before) / 2;
    before = out[i];
    out[i] += r.tail_share * (late - out[i]);
  }
  return out;
}

// Power by fine range as seen from the radar.
struct FineRanges {
  static constexpr double step_m = 0.02;
  std::vector<double> body, plate;
};

VectorXd profile(const std::vector<double>& fine, const Conditions& c, double shift, double width,
                 Eigen::Index first, Eigen::Index count) {
  const Psf psf = c.radar_psf == "sinc" ? Psf::sinc : Psf::blackman;
  const double cell = c.radar_resolution_m * (1 + width);
  VectorXd out = VectorXd::Zero(count);
  for (std::size_t k = 0; k < fine.size(); ++k) {
    if (fine[k] == 0) continue;
    const double range = (static_cast<double>(k) + 0.5) * FineRanges::step_m + shift;
    for (Eigen::Index j = 0; j < count; ++j) {
      const double at = c.radar_start_m + static_cast<double>(first + j) * c.radar_step_m;
      const double amplitude = psf_amplitude(psf, (at - range) / cell);
      out[j] += fine[k] * amplitude * amplitude;
    }
  }
  return out;
}

}  // namespace

LightFit fit_light(const Surface& surface, const std::vector<double>& counts, const Conditions& c) {
  LightFit fit;
  MatrixXd sharp(c.bins, zones), columns(c.bins, zones);
  for (int zone = 0; zone < zones; ++zone) {
    sharp.col(zone) = histogram_of(surface, static_cast<Zone>(zone), c);
    columns.col(zone) = responded(sharp.col(zone), c.bin_width_ps, {});
  }
  fit.expected = sharp.sum();
  const VectorXd measured = Eigen::Map<const VectorXd>(counts.data(), c.bins);
  // Who comes out darker than nothing is left out, and the others are fitted again.
  VectorXd found = VectorXd::Zero(zones);
  for (int round = 0; round < zones; ++round) {
    found = least_squares(columns, measured);
    if (found.minCoeff() >= 0) break;
    for (int zone = 0; zone < zones; ++zone)
      if (found[zone] < 0) columns.col(zone).setZero();
    found = found.cwiseMax(0);
  }
  fit.torso = found[static_cast<int>(Zone::torso)];
  fit.legs = found[static_cast<int>(Zone::legs)];
  fit.head = found[static_cast<int>(Zone::head)];
  fit.plate = found[static_cast<int>(Zone::plate)];
  const VectorXd all = sharp * found;
  fit.rendered.assign(all.data(), all.data() + all.size());
  return fit;
}

EchoFit fit_echo(const Surface& surface, const std::vector<double>& power, const Conditions& c) {
  FineRanges fine;
  EchoFit fit;
  double nearest = 1e9, farthest = 0, sine = 0;
  for (const SurfacePatch& p : surface.patches) {
    const double range = length_of(p.x + c.baseline_m, p.y, p.z);
    const double from_spd = length_of(p.x, p.y, p.z);
    const double w = p.weight / (range * range);
    auto& to = p.zone == Zone::plate ? fine.plate : fine.body;
    const auto k = static_cast<std::size_t>(range / FineRanges::step_m);
    if (k >= to.size()) to.resize(k + 1);
    to[k] += w;
    fit.expected += w;
    sine += w * p.x / from_spd;
    nearest = std::min(nearest, range);
    farthest = std::max(farthest, range);
  }
  fit.sine = sine / fit.expected;
  const auto index = [&](double range) {
    return std::clamp<Eigen::Index>(
        static_cast<Eigen::Index>(std::lround((range - c.radar_start_m) / c.radar_step_m)), 0,
        c.radar_bins - 1);
  };
  const Eigen::Index first = index(nearest - 2 * c.radar_resolution_m);
  const Eigen::Index last = index(farthest + 2 * c.radar_resolution_m);
  const Eigen::Index count = last - first + 1;
  const VectorXd all = Eigen::Map<const VectorXd>(power.data(), c.radar_bins);
  const VectorXd y = all.segment(first, count);
  const bool has_plate = !fine.plate.empty();
  // Gauss and Newton: amplitudes, shift and width together, from amplitudes alone.
  double shift = 0, width = 0;
  const double h = 0.01;
  MatrixXd columns(count, has_plate ? 4 : 3);
  VectorXd found;
  for (int step = 0; step < 4; ++step) {
    const auto model = [&](double s, double w) {
      MatrixXd m(count, 2);
      m.col(0) = profile(fine.body, c, s, w, first, count);
      m.col(1) = profile(fine.plate, c, s, w, first, count);
      return m;
    };
    const MatrixXd here = model(shift, width);
    const MatrixXd amplitudes = has_plate ? here : MatrixXd(here.leftCols(1));
    VectorXd a = least_squares(amplitudes, y).cwiseMax(0);
    fit.body = a[0];
    fit.plate = has_plate ? a[1] : 0;
    const Eigen::Vector2d both(fit.body, fit.plate);
    const VectorXd rest = y - here * both;
    fit.noise =
        std::sqrt(rest.squaredNorm() / static_cast<double>(std::max<Eigen::Index>(1, count - 4)));
    fit.peak = (here * both).maxCoeff();
    if (step == 3) break;
    columns.leftCols(has_plate ? 2 : 1) = amplitudes;
    columns.col(columns.cols() - 2) =
        (model(shift + h, width) - model(shift - h, width)) * both / (2 * h);
    columns.col(columns.cols() - 1) =
        (model(shift, width + h) - model(shift, width - h)) * both / (2 * h);
    found = least_squares(columns, y - here * both);
    shift = std::clamp(shift + found[columns.cols() - 2], -0.3, 0.3);
    width = std::clamp(width + found[columns.cols() - 1], -0.3, 0.5);
  }
  fit.shift_m = shift;
  fit.width = width;
  // What the model does not have: the transmitter's own echo, and what comes late.
  const Eigen::Vector2d both(fit.body, fit.plate);
  MatrixXd whole(c.radar_bins, 2);
  whole.col(0) = profile(fine.body, c, shift, width, 0, c.radar_bins);
  whole.col(1) = profile(fine.plate, c, shift, width, 0, c.radar_bins);
  const VectorXd left = all - whole * both;
  const Eigen::Index near = index(c.radar_start_m + 0.5 * c.radar_resolution_m);
  fit.leakage = left.head(near + 1).mean();
  const Eigen::Index from = index(farthest + 0.6), to = index(farthest + 1.6);
  fit.behind = left.segment(from, to - from + 1).mean();
  return fit;
}

void ResponseFit::add(std::vector<double> rendered, std::vector<double> counts) {
  // Weights of shot noise, about a mean of five bins.
  const auto n = static_cast<int>(counts.size());
  std::vector<double> weight(counts.size());
  for (int i = 0; i < n; ++i) {
    double mean = 0;
    for (int k = -2; k <= 2; ++k)
      mean += counts[static_cast<std::size_t>(std::clamp(i + k, 0, n - 1))] / 5;
    weight[static_cast<std::size_t>(i)] = 1 / std::sqrt(std::max(0.0, mean) + 30);
  }
  records_.push_back({std::move(rendered), std::move(counts), std::move(weight)});
}

VectorXd ResponseFit::residual(const Response& r) const {
  const auto n = static_cast<Eigen::Index>(records_.front().counts.size());
  VectorXd all(n * static_cast<Eigen::Index>(records_.size()));
  Eigen::Index at = 0;
  for (const Record& record : records_) {
    const auto view = [&](const std::vector<double>& v) {
      return Eigen::Map<const VectorXd>(v.data(), n);
    };
    const VectorXd weight = view(record.weight);
    const VectorXd model = responded(view(record.rendered), bin_ps_, r).cwiseProduct(weight);
    const VectorXd seen = view(record.counts).cwiseProduct(weight);
    const double scale = model.dot(seen) / std::max(1e-300, model.squaredNorm());
    all.segment(at, n) = seen - scale * model;
    at += n;
  }
  return all;
}

ResponseFit::Response ResponseFit::solve() const {
  Response r;
  if (records_.empty()) return r;
  for (int step = 0; step < 5; ++step) {
    const VectorXd here = residual(r);
    MatrixXd slopes(here.size(), 3);
    const double dt = 5, ds = 0.05, dq = 0.05;
    Response moved = r;
    moved.delay_ps += dt;
    slopes.col(0) = (residual(moved) - here) / dt;
    moved = r;
    moved.sigma_ps *= std::exp(ds);
    slopes.col(1) = (residual(moved) - here) / ds;
    moved = r;
    moved.tail_share += dq;
    slopes.col(2) = (residual(moved) - here) / dq;
    const VectorXd by = least_squares(slopes, here);
    r.delay_ps = std::clamp(r.delay_ps - by[0], -500.0, 500.0);
    r.sigma_ps = std::clamp(r.sigma_ps * std::exp(-std::clamp(by[1], -0.5, 0.5)), 20.0, 500.0);
    r.tail_share = std::clamp(r.tail_share - by[2], -0.3, 0.9);
  }
  return r;
}

}  // namespace echofuse::sim
