// SPDX-License-Identifier: MIT
#include "sim/scene/draw.hpp"

#include <functional>
#include <map>

#include "../catch.hpp"

using namespace echofuse::sim;

namespace {

// Compares random draws with a distribution by Pearson's chi-squared test. All values that are
// expected fewer than ten times are combined into one class. Returns the z-score (chi2 - n) /
// sqrt(2n), where n is the number of classes.
double fit_score(int draws, const std::function<std::int64_t()>& draw,
                 const std::function<double(double)>& log_probability, double mean, double sigma) {
  std::map<std::int64_t, int> seen;
  for (int i = 0; i < draws; ++i) ++seen[draw()];
  double chi2 = 0, expected_rest = draws;
  int seen_rest = draws, classes = 0;
  const auto first = static_cast<std::int64_t>(std::max(0.0, mean - 9 * sigma));
  for (auto k = first; static_cast<double>(k) < mean + 9 * sigma + 9; ++k) {
    const double expected = draws * std::exp(log_probability(static_cast<double>(k)));
    if (expected < 10) continue;
    chi2 += std::pow(seen[k] - expected, 2) / expected;
    expected_rest -= expected;
    seen_rest -= seen[k];
    ++classes;
  }
  if (expected_rest > 10) chi2 += std::pow(seen_rest - expected_rest, 2) / expected_rest;
  return (chi2 - classes) / std::sqrt(2.0 * classes);
}

}  // namespace

TEST_CASE("Poisson samples follow the Poisson distribution") {
  Rng rng = make_rng(1, 1);
  CHECK(poisson(0, rng) == 0);
  for (const double mean : {0.02, 1.0, 9.99, 10.01, 31.7, 500.0, 2e4}) {
    const double z = fit_score(
        200'000, [&] { return poisson(mean, rng); },
        [&](double k) { return k * std::log(mean) - mean - std::lgamma(k + 1); }, mean,
        std::sqrt(mean));
    CAPTURE(mean);
    CHECK(std::abs(z) < 4.5);
  }
}

TEST_CASE("binomial samples follow the binomial distribution") {
  Rng rng = make_rng(1, 2);
  CHECK(binomial(0, 0.5, rng) == 0);
  CHECK(binomial(7, 0, rng) == 0);
  CHECK(binomial(7, 1, rng) == 7);
  struct Case {
    std::int64_t n;
    double p;
  };
  for (const auto& [n, p] : {Case{5, 0.3}, Case{1000, 0.002}, Case{40, 0.5}, Case{300, 0.9},
                             Case{3'000'000, 1e-4}, Case{100'000, 0.2}}) {
    const auto trials = static_cast<double>(n);
    const auto log_probability = [&, chance = p](double k) -> double {
      if (k > trials) return -INFINITY;
      return std::lgamma(trials + 1) - std::lgamma(k + 1) - std::lgamma(trials - k + 1) +
             k * std::log(chance) + (trials - k) * std::log1p(-chance);
    };
    const double z = fit_score(
        200'000, [&, count = n, chance = p] { return binomial(count, chance, rng); },
        log_probability, trials * p, std::sqrt(trials * p * (1 - p)));
    CAPTURE(trials, p);
    CHECK(std::abs(z) < 4.5);
  }
}
