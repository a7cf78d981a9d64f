// SPDX-License-Identifier: MIT
#include "sim/sensors/optics.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>

#include "drivers/core/clones.hpp"
#include "sim/scene/draw.hpp"

namespace echofuse::sim {
namespace {

std::int64_t ceil_of(double x) { return static_cast<std::int64_t>(std::ceil(x)); }

// Impulse response (IRF) of the detector to a photon at time 0. cdf(t) is its integral up to t.
class Irf {
 public:
  explicit Irf(const Conditions& c)
      : sigma_(c.irf_fwhm_ps / (2 * std::sqrt(2 * std::numbers::ln2))),
        tail_(c.irf_tail_ps),
        share_(c.irf_tail_share) {}

  bool operator==(const Irf&) const = default;
  double sigma() const { return sigma_; }
  // Less than 1e-9 of the IRF is outside [begin, end].
  double begin() const { return -6.2 * sigma_; }
  double end() const { return 6.2 * sigma_ + 21 * tail_; }
  double cdf(double t) const {
    const double gaussian = normal(t / sigma_);
    return tail_ > 0 ? gaussian - share_ * late(t) : gaussian;
  }

 private:
  static double normal(double u) { return 0.5 * std::erfc(-u / std::numbers::sqrt2); }
  // Returns the amount by which an exponential tail reduces the cumulative Gaussian at t. Uses
  // logarithms, because the exponential alone overflows for sigma >> tail.
  double late(double t) const {
    const double ratio = sigma_ / tail_;
    const double share = normal(t / sigma_ - ratio);
    return share > 0 ? std::exp(ratio * ratio / 2 - t / tail_ + std::log(share)) : 0;
  }
  double sigma_, tail_, share_;
};

// Adds the light of all grid points of one bin: for each point, its weight times its row of
// `shares` (fractions of its light in each bin). Rows are `stride` apart.
ECHOFUSE_CLONES void add_shares(const double* weights, std::size_t points, const double* shares,
                                std::size_t stride, std::size_t count, double* __restrict__ bins) {
  for (std::size_t i = 0; i < points; ++i) {
    if (weights[i] == 0) continue;
    for (std::size_t j = 0; j < count; ++j) bins[j] += weights[i] * shares[i * stride + j];
  }
}

// Signal on a time grid that is finer than the bins and the IRF, with `phases` points per bin. Each
// return is split linearly between its two neighbouring points. At a spacing of sigma/16 this
// widens the IRF by less than 4e-4 of its width.
class FineSignal {
 public:
  FineSignal(const Conditions& c, const Irf& irf)
      : phases_(std::clamp(ceil_of(16 * c.bin_width_ps / irf.sigma()), std::int64_t{16},
                           std::int64_t{512})),
        step_(c.bin_width_ps / static_cast<double>(phases_)),
        bins_before_(ceil_of(irf.end() / c.bin_width_ps) + 1),
        start_(c.first_bin_ps - static_cast<double>(bins_before_) * c.bin_width_ps),
        weights_(static_cast<std::size_t>(
            phases_ * (bins_before_ + c.bins + ceil_of(-irf.begin() / c.bin_width_ps) + 1))) {}

  void add(double t_ps, double weight) {
    const double place = (t_ps - start_) / step_;
    if (!(place >= 0 && place < static_cast<double>(weights_.size() - 1))) return;
    const auto i = static_cast<std::size_t>(place);
    const double rest = place - static_cast<double>(i);
    weights_[i] += (1 - rest) * weight;
    weights_[i + 1] += rest * weight;
  }

  // Adds to each bin a fraction of every grid point. The fraction depends only on the position of
  // the point within its bin and on the distance between that bin and the receiving bin.
  void spread(const Irf& irf, double width_ps, std::vector<double>& bins) const {
    const std::int64_t first = -ceil_of(-irf.begin() / width_ps) - 1;
    const std::int64_t last = ceil_of(irf.end() / width_ps) + 1;
    const auto length = static_cast<std::size_t>(last - first);
    // The shares are cached for the next record, because they depend only on the IRF and the bin
    // width.
    thread_local std::vector<double> shares;
    thread_local std::optional<std::pair<Irf, double>> of;
    if (of != std::pair{irf, width_ps}) {
      of.reset();
      shares.resize(static_cast<std::size_t>(phases_) * length);
      for (std::int64_t p = 0; p < phases_; ++p)
        for (std::size_t j = 0; j < length; ++j) {
          const double t = (static_cast<double>(first) + static_cast<double>(j)) * width_ps -
                           static_cast<double>(p) * step_;
          shares[static_cast<std::size_t>(p) * length + j] = irf.cdf(t + width_ps) - irf.cdf(t);
        }
      of = {irf, width_ps};
    }
    const auto count = static_cast<std::int64_t>(bins.size());
    const auto phases = static_cast<std::size_t>(phases_);
    for (std::size_t i = 0; i < weights_.size(); i += phases) {
      const std::int64_t bin = static_cast<std::int64_t>(i / phases) - bins_before_ + first;
      const std::int64_t from = std::max<std::int64_t>(0, -bin);
      const std::int64_t to = std::min(static_cast<std::int64_t>(length), count - bin);
      if (from < to)
        add_shares(&weights_[i], phases, shares.data() + from, length,
                   static_cast<std::size_t>(to - from),
                   &bins[static_cast<std::size_t>(bin + from)]);
    }
  }

 private:
  std::int64_t phases_;
  double step_;
  // Number of grid bins before bin 0 from which the IRF extends into bin 0.
  std::int64_t bins_before_;
  double start_;
  std::vector<double> weights_;
};

std::vector<std::uint32_t> count_running_free(const std::vector<double>& rate, const Conditions& c,
                                              Rng& rng) {
  const double period_ps = 1e12 * c.window_s / static_cast<double>(c.pulses_per_window);
  struct Photon {
    double time_ps;
    std::size_t bin;
  };
  std::vector<Photon> photons;
  for (std::size_t i = 0; i < rate.size(); ++i)
    for (std::int64_t n = poisson(rate[i], rng); n > 0; --n) {
      const auto pulse = rng() % static_cast<std::uint64_t>(c.pulses_per_window);
      const double bin = static_cast<double>(i) + uniform(rng, 0, 1);
      photons.push_back({static_cast<double>(pulse) * period_ps + bin * c.bin_width_ps, i});
    }
  std::sort(photons.begin(), photons.end(),
            [](const Photon& a, const Photon& b) { return a.time_ps < b.time_ps; });
  std::vector<std::uint32_t> counts(rate.size());
  double ready_ps = 0;
  for (const Photon& photon : photons) {
    if (photon.time_ps < ready_ps) continue;
    ++counts[photon.bin];
    ready_ps = photon.time_ps + c.spd_dead_time_ps;
  }
  return counts;
}

}  // namespace

std::vector<double> spd_rate(const Returns& returns, const Conditions& c) {
  const Irf irf(c);
  FineSignal signal(c, irf);
  const auto add = [&](std::size_t k) {
    signal.add(ps_per_m * returns.range_m[k], c.signal_photons * returns.weight[k]);
  };
  // Adds returns from four parts of the list in turn. Successive returns in the list often fall in
  // the same bin, and each addition would then have to wait for the previous addition.
  constexpr std::size_t parts = 4;
  const std::size_t count = returns.range_m.size(), part = count / parts;
  for (std::size_t k = 0; k < part; ++k)
    for (std::size_t p = 0; p < parts; ++p) add(p * part + k);
  for (std::size_t k = parts * part; k < count; ++k) add(k);
  std::vector<double> rate(static_cast<std::size_t>(c.bins),
                           c.background_counts / static_cast<double>(c.bins));
  signal.spread(irf, c.bin_width_ps, rate);
  return rate;
}

std::vector<std::uint32_t> draw_counts(const std::vector<double>& rate, const Conditions& c,
                                       Rng& rng) {
  if (c.spd_dead_time_ps > 0) return count_running_free(rate, c, rng);
  std::vector<std::uint32_t> counts(rate.size());
  if (c.pulses_per_window == 0) {
    std::transform(rate.begin(), rate.end(), counts.begin(),
                   [&](double mean) { return static_cast<std::uint32_t>(poisson(mean, rng)); });
    return counts;
  }
  const auto pulses = static_cast<double>(c.pulses_per_window);
  std::int64_t waiting = c.pulses_per_window;  // number of pulses without a detection so far
  for (std::size_t i = 0; i < rate.size(); ++i) {
    const double chance = -std::expm1(-rate[i] / pulses);
    const std::int64_t n = binomial(waiting, chance, rng);
    counts[i] = static_cast<std::uint32_t>(n);
    waiting -= n;
  }
  return counts;
}

record::Detector stated_detector(const Conditions& c) {
  if (c.pulses_per_window == 0 || !c.spd_detector_stated) return {};
  return {c.spd_dead_time_ps > 0 ? c.spd_dead_time_ps : std::numeric_limits<double>::infinity()};
}

}  // namespace echofuse::sim
