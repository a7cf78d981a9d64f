// SPDX-License-Identifier: MIT
#include "recon/data/pile_up.hpp"

#include "../catch.hpp"
#include "recon/numbers/statistics.hpp"

namespace {

using namespace echofuse::recon;

constexpr double bin_ps = 100, period_ps = 20'000;
constexpr std::size_t bins = 60;
constexpr int pulses = 4000;
constexpr double window_s = 1e-12 * period_ps * pulses;

// Returns the mean number of photons per pulse in each bin. The distribution has a constant
// background and a peak in bins 30 to 35. `all` is the sum over the bins.
std::vector<double> photons_a_pulse(double all) {
  std::vector<double> out(bins, 0.3 / bins);
  for (std::size_t i = 30; i < 36; ++i) out[i] += 0.7 / 6;
  for (double& q : out) q *= all;
  return out;
}

// Simulates each photon that reaches a detector with a dead time, and returns the detector's
// counts.
std::vector<float> detected(const std::vector<double>& q, double dead_ps, Rng& rng) {
  std::vector<float> out(bins);
  double ready_ps = 0;
  for (int pulse = 0; pulse < pulses; ++pulse) {
    bool seen = false;
    for (std::size_t i = 0; i < bins; ++i) {
      std::poisson_distribution<int> photons(q[i]);
      std::uniform_real_distribution<double> within(0, bin_ps);
      std::vector<double> times;
      for (int n = photons(rng); n > 0; --n)
        times.push_back(pulse * period_ps + static_cast<double>(i) * bin_ps + within(rng));
      std::sort(times.begin(), times.end());
      for (const double t : times) {
        if (std::isinf(dead_ps) ? seen : t < ready_ps) continue;
        ++out[i], seen = true, ready_ps = t + dead_ps;
      }
    }
  }
  return out;
}

}  // namespace

TEST_CASE("pile-up correction recovers the photons of each bin within the expected error") {
  const double dead_ps = GENERATE(std::numeric_limits<double>::infinity(), 1000., 7000., 45'000.);
  const double all = GENERATE(0.1, 2.);
  const auto q = photons_a_pulse(all);
  const PileUp pile_up(dead_ps, window_s, bin_ps);
  constexpr int draws = 20;
  std::vector<double> sum(bins), raw_sum(bins);
  Rng rng = make_rng(1, static_cast<std::uint64_t>(all * 10));
  for (int d = 0; d < draws; ++d) {
    auto counts = detected(q, dead_ps, rng);
    for (std::size_t i = 0; i < bins; ++i) raw_sum[i] += double{counts[i]};
    pile_up.correct(counts, pulses);
    for (std::size_t i = 0; i < bins; ++i) sum[i] += double{counts[i]};
  }
  double worst = 0, chi2 = 0, raw_chi2 = 0;
  for (std::size_t i = 0; i < bins; ++i) {
    // The raw count is binomially distributed with `ready` trials and the probability 1 - exp(-q).
    // The delta method gives the variance of the corrected count.
    const double photons = pulses * q[i] * draws;
    const double ready = raw_sum[i] / -std::expm1(-q[i]);
    const double variance = std::pow(double{pulses} * draws, 2) * std::expm1(q[i]) / ready;
    const double z = (sum[i] - photons) / std::sqrt(variance);
    worst = std::max(worst, std::abs(z)), chi2 += z * z / bins;
    raw_chi2 += std::pow(raw_sum[i] - photons, 2) / variance / bins;
  }
  INFO("dead time " << dead_ps << " ps, photons a pulse " << all);
  CHECK(worst < 4);
  CHECK(chi2 < 1.7);
  if (all > 1) CHECK(raw_chi2 > 10);
}

TEST_CASE("pile-up correction returns the lowest fraction of pulses with a ready detector") {
  const PileUp pile_up(std::numeric_limits<double>::infinity(), 1, 100);
  std::vector<float> some{0, 500, 0}, nearly_all{0, 990, 0};
  CHECK(pile_up.correct(some, 1000) == Approx(0.5));
  CHECK(pile_up.correct(nearly_all, 1000) == Approx(0.01));
}

TEST_CASE("pile-up correction keeps the counts of an unknown detector or number of pulses") {
  const std::vector<float> before{5, 700, 3};
  std::vector<float> counts = before;
  PileUp().correct(counts, 1000);
  PileUp(1000, 1, 100).correct(counts, 0);
  CHECK(counts == before);
  // More clicks than pulses give finite photon numbers.
  PileUp(std::numeric_limits<double>::infinity(), 1, 100).correct(counts, 600);
  for (const float n : counts) CHECK((std::isfinite(n) && n >= 0));
}
