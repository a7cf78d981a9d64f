// SPDX-License-Identifier: MIT
#include "sim/sensors/optics.hpp"

#include "../catch.hpp"
#include "scenes.hpp"

using namespace echofuse::sim;

namespace {

double range_of(double t_ps) { return t_ps * 1e-12 * speed_of_light_m_s / 2; }

double sigma_ps(const Conditions& c) { return c.irf_fwhm_ps / std::sqrt(8 * std::log(2.0)); }

double gauss_bin(double from, double to, double sigma) {
  const auto phi = [&](double t) { return 0.5 * std::erfc(-t / sigma / std::numbers::sqrt2); };
  return phi(to) - phi(from);
}

Returns one_return(double t_ps) { return {{range_of(t_ps)}, {1.0}}; }

struct Moments {
  double sum = 0, mean = 0, variance = 0;
};
Moments moments_of(const std::vector<double>& rate, const Conditions& c) {
  Moments m;
  double squares = 0;
  for (std::size_t i = 0; i < rate.size(); ++i) {
    const double t = c.first_bin_ps + (static_cast<double>(i) + 0.5) * c.bin_width_ps;
    m.sum += rate[i];
    m.mean += rate[i] * t;
    squares += rate[i] * t * t;
  }
  m.mean /= m.sum;
  m.variance = squares / m.sum - m.mean * m.mean;
  return m;
}

// Scores of simulated counts. `chi2_per_bin` is the mean of z^2 over draws and bins. `worst` is the
// largest |z| of a bin's mean count.
struct Scores {
  double chi2_per_bin = 0, worst = 0;
};
Scores scores_of(const std::vector<double>& rate, const std::vector<double>& mean,
                 const std::vector<double>& variance, const Conditions& c, int draws) {
  Rng rng = make_rng(7, 0);
  std::vector<double> sums(rate.size());
  Scores s;
  std::size_t terms = 0;
  for (int d = 0; d < draws; ++d) {
    const auto counts = draw_counts(rate, c, rng);
    for (std::size_t i = 0; i < rate.size(); ++i) {
      sums[i] += counts[i];
      if (variance[i] < 1e-9) continue;
      s.chi2_per_bin += (counts[i] - mean[i]) * (counts[i] - mean[i]) / variance[i];
      ++terms;
    }
  }
  s.chi2_per_bin /= static_cast<double>(terms);
  for (std::size_t i = 0; i < rate.size(); ++i)
    if (variance[i] > 1e-3)
      s.worst =
          std::max(s.worst, std::abs(sums[i] - draws * mean[i]) / std::sqrt(draws * variance[i]));
  return s;
}

}  // namespace

TEST_CASE("splitting a return linearly between bins stays within the documented error bound") {
  for (const double fwhm : {50.0, 200.0, 700.0}) {
    Conditions c;
    c.irf_fwhm_ps = fwhm;
    c.signal_photons = 1;
    // The error is at most step^2 / 8 times the largest second derivative of the fraction in the
    // bin. Each of the two bin edges contributes at most max |x phi(x)| / sigma^2 = 0.242 / sigma^2
    // to this derivative, where phi is the normal density. The step is at most sigma / 16.
    // A return at a bin edge is not split.
    const double split = 2 * 0.242 / 8 / 256 + 1e-9;
    for (int k = 0; k < 50; ++k) {
      const double bound = k == 0 ? 3e-9 : split;
      const double t = c.first_bin_ps + 10'000 + 7.3 * k;
      const auto rate = spd_rate(one_return(t), c);
      for (std::size_t i = 0; i < rate.size(); ++i) {
        const double from = c.first_bin_ps + static_cast<double>(i) * c.bin_width_ps - t;
        REQUIRE(std::abs(rate[i] - gauss_bin(from, from + c.bin_width_ps, sigma_ps(c))) < bound);
      }
    }
  }
}

TEST_CASE("a return keeps its energy when binned, and has the mean and the variance of the IRF") {
  for (const double tail : {0.0, 40.0, 400.0})
    for (const double fwhm : {2.0, 200.0, 1000.0}) {
      Conditions c;
      c.irf_fwhm_ps = fwhm;
      c.irf_tail_ps = tail;
      const double t = c.first_bin_ps + 9'050;
      const Moments m = moments_of(spd_rate(one_return(t), c), c);
      CHECK(m.sum == Approx(c.signal_photons).epsilon(3e-9));
      // The bins are too coarse to compute the moments of such a narrow response.
      if (fwhm < 200 && tail < 100) continue;
      const double sigma = sigma_ps(c), w = c.bin_width_ps;
      // The exponential tail starts with a jump of height f(0) = 1/tail. For bins of width w, this
      // jump moves the mean of the binned values by at most w^2 f(0) / 12 (Euler-Maclaurin).
      CHECK(m.mean ==
            Approx(t + tail).margin(tail > 0 && fwhm < 200 ? w * w / 12 / tail : 1e-3 * w));
      // Sharing a return between points that are sigma/16 apart adds at most (sigma/16)^2 / 4 to
      // the variance. For bins of width w, the start of the tail adds w^2 / 12 times the change of
      // slope of (t - mean)^2 f(t), which is 2.
      const double widening = sigma * sigma / 1024 + (fwhm < 200 ? w * w / 6 : 0);
      CHECK(std::abs(m.variance - sigma * sigma - tail * tail - w * w / 12) < widening);
    }
}

TEST_CASE("light from outside the time axis contributes only where the IRF extends into the axis") {
  Conditions c;
  c.background_counts = 672;
  for (const double r : spd_rate({}, c)) CHECK(r == Approx(2).epsilon(1e-12));
  c.background_counts = 0;
  const double end = c.first_bin_ps + static_cast<double>(c.bins) * c.bin_width_ps;
  // The return is centred on an edge of the histogram, so half of its counts are in the histogram.
  for (const double edge : {c.first_bin_ps, end})
    CHECK(total(spd_rate(one_return(edge), c)) == Approx(c.signal_photons / 2).epsilon(1e-6));
  for (const double t : {1000.0, c.first_bin_ps - 2000, end + 2000, 1e6})
    CHECK(total(spd_rate(one_return(t), c)) == 0);
  // Light that arrives before the first bin contributes to the histogram through the tail of the
  // IRF.
  c.irf_tail_ps = 3000;
  CHECK(
      total(spd_rate(one_return(c.first_bin_ps - 6000), c)) ==
      Approx(c.signal_photons * std::exp(-2 + std::pow(sigma_ps(c) / 3000, 2) / 2)).epsilon(1e-3));
}

TEST_CASE("a scene in an asymmetric room and its mirror image have different SPD histograms") {
  Conditions c;
  c.background = "room";
  for (std::uint64_t i = 0; i < 6; ++i) {
    const Scene scene = make_scene(c, SceneKind::person, 3, i);
    if (std::abs(scene.capsules[0].a.x) < 0.2) continue;
    const auto a = spd_rate(spd_returns(scene, c), c);
    const auto b = spd_rate(spd_returns(mirrored(scene), c), c);
    double chi2 = 0;
    for (std::size_t k = 0; k < a.size(); ++k)
      if (a[k] + b[k] > 0) chi2 += (a[k] - b[k]) * (a[k] - b[k]) / (a[k] + b[k]);
    // The difference between the mirrored scenes is at least 20 standard deviations of the shot
    // noise.
    CHECK(chi2 > 20 * 20);
  }
}

TEST_CASE("the automatic number of rays keeps the error below a tenth of the shot-noise variance") {
  for (const double photons : {1e3, 1e4, 1e5}) {
    Conditions c, fine;
    c.signal_photons = fine.signal_photons = photons;
    fine.spd_rays = 4 * rays_of(c);
    double sum = 0;
    int bins = 0;
    for (std::uint64_t i = 0; i < 30; ++i) {
      const auto a = spd_rate(spd_returns(some_scene(c, i), c), c);
      const auto b = spd_rate(spd_returns(some_scene(c, i), fine), fine);
      for (std::size_t k = 0; k < a.size(); ++k)
        if (b[k] >= 1) sum += (a[k] - b[k]) * (a[k] - b[k]) / b[k], ++bins;
    }
    CAPTURE(photons, rays_of(c));
    CHECK(sum / bins < 0.1);
  }
}

TEST_CASE(
    "simulated counts follow a Poisson distribution, or count the first photon of each pulse") {
  struct Row {
    std::int64_t pulses;
    double signal, background, dead_time_ps;
    int draws;
  };
  // In the last row, the pulse period is 3 s / 2e7 = 150 ns, and the dead time of 50 ns is longer
  // than the histogram, which covers 34 ns.
  const Row row = GENERATE(Row{0, 3e4, 300, 0, 400}, Row{20'000, 2e4, 5000, 0, 300},
                           Row{20'000'000, 1e5, 2e4, 50'000, 30});
  CAPTURE(row.pulses);
  Conditions c;
  c.pulses_per_window = row.pulses, c.spd_dead_time_ps = row.dead_time_ps;
  c.signal_photons = row.signal, c.background_counts = row.background;
  const auto rate = spd_rate(spd_returns(some_scene(c, 2), c), c);
  const auto pulses = static_cast<double>(row.pulses);
  const auto [mean, variance] =
      row.pulses > 0 ? first_photons(rate, pulses) : FirstPhotons{rate, rate};
  // For n independent counts with variance v, the variance of the mean of z^2 is (2 + 1/v) / n. The
  // counts of first photons are multinomial. The correlation of bins i and j is -sqrt(o_i o_j),
  // where o = p / (1 - p). `odds` is the sum of o over all bins. The correlations add at most
  // 2 odds^2 to the variance of the sum of z^2.
  double spread = 0, odds = 0;
  for (std::size_t i = 0; i < rate.size(); ++i) {
    spread += 2 + 1 / variance[i];
    if (row.pulses > 0) odds += mean[i] / (pulses - mean[i]);
  }
  const Scores s = scores_of(rate, mean, variance, c, row.draws);
  CHECK(s.worst < 4.5);
  CHECK(std::abs(s.chi2_per_bin - 1) <
        4.5 * std::sqrt((spread + 2 * odds * odds) / row.draws) / static_cast<double>(rate.size()));
}
