// SPDX-License-Identifier: MIT
#include "recon/network/network.hpp"

#include "../catch.hpp"
#include "recon/network/adam.hpp"
#include "recon/numbers/blas.hpp"

using namespace echofuse::recon;

namespace {

std::vector<double> normal(std::size_t n, Rng& rng) {
  std::normal_distribution<double> d;
  std::vector<double> out(n);
  for (double& v : out) v = d(rng);
  return out;
}

struct Problem {
  Network network = make_network({7, 9, 5, 6});
  std::size_t batch = 4;
  std::vector<double> parameters, inputs, targets;
  explicit Problem(std::uint64_t seed) {
    Rng rng = make_rng(seed, 0);
    parameters = normal(network.parameters, rng);
    inputs = normal(batch * 7, rng);
    targets = normal(batch * 6, rng);
  }
  // Returns half of the sum of the squared errors.
  double loss(const std::vector<double>& p) const {
    Activations<double> a;
    forward(network, p, inputs.data(), batch, a);
    double sum = 0;
    for (std::size_t i = 0; i < targets.size(); ++i) sum += std::pow(a.back()[i] - targets[i], 2);
    return sum / 2;
  }
};

}  // namespace

TEST_CASE("the network gradient equals central differences for every parameter") {
  const Problem q(3);
  Activations<double> a;
  forward(q.network, q.parameters, q.inputs.data(), q.batch, a);
  for (std::size_t i = 0; i < q.targets.size(); ++i) a.back()[i] -= q.targets[i];
  std::vector<double> gradient;
  backward(q.network, q.parameters, q.inputs.data(), q.batch, a, gradient);
  REQUIRE(gradient.size() == q.network.parameters);
  // The loss is quadratic in each parameter as long as no ReLU switches. Central differences are
  // then exact, except for rounding errors of about 1e-16 * loss / step.
  constexpr double step = 1e-5;
  const double rounding = 1e-15 * q.loss(q.parameters) / step;
  for (std::size_t i = 0; i < gradient.size(); ++i) {
    auto up = q.parameters, down = q.parameters;
    up[i] += step, down[i] -= step;
    const double slope = (q.loss(up) - q.loss(down)) / (2 * step);
    CAPTURE(i);
    REQUIRE(gradient[i] == Approx(slope).margin(20 * rounding).epsilon(1e-9));
  }
}

// Products with a single row use different code than products with several rows.
TEST_CASE("matrix products equal plain sums for any size, with and without transposition") {
  const std::size_t m = GENERATE(1, 5), n = GENERATE(1, 7, 48), k = GENERATE(1, 4, 61);
  const auto ta = GENERATE(Transpose::no, Transpose::yes);
  const auto tb = GENERATE(Transpose::no, Transpose::yes);
  const double beta = GENERATE(0., 1., -2.);
  Rng rng = make_rng(8, 0);
  const auto a = normal(m * k, rng), b = normal(k * n, rng), before = normal(m * n, rng);
  const std::vector<float> x(a.begin(), a.end()), w(b.begin(), b.end());
  auto c = before;
  std::vector<float> y(before.begin(), before.end());
  multiply({m, n, k, ta, tb, 1.5, beta}, a.data(), b.data(), c.data());
  multiply({m, n, k, ta, tb, 1.5f, static_cast<float>(beta)}, x.data(), w.data(), y.data());
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t j = 0; j < n; ++j) {
      double sum = beta * before[i * n + j];
      for (std::size_t l = 0; l < k; ++l)
        sum += 1.5 * a[ta == Transpose::yes ? l * m + i : i * k + l] *
               b[tb == Transpose::yes ? j * k + l : l * n + j];
      CHECK(c[i * n + j] == Approx(sum).margin(1e-12));
      CHECK(double{y[i * n + j]} == Approx(sum).margin(1e-4));
    }
}

TEST_CASE("the first step of the Adam optimizer has the size of the learning rate") {
  std::vector<float> p = {1, 1, 1};
  Adam adam(3, 0);
  std::vector<float> gradient = {1e-3f, -50, 0};
  adam.step(p, gradient, 0.01);
  CHECK(gradient == std::vector<float>(3));
  CHECK(p[0] == Approx(0.99).epsilon(1e-4));
  CHECK(p[1] == Approx(1.01).epsilon(1e-4));
  CHECK(p[2] == 1);
  Adam decaying(1, 0.5);
  std::vector<float> weight = {2};
  std::vector<float> none = {0};
  decaying.step(weight, none, 0.1);
  CHECK(weight[0] == Approx(2 * (1 - 0.1 * 0.5)));
}

TEST_CASE("moments of Adam are never subnormal, and a NaN gradient gives a NaN weight") {
  const auto subnormal = [](float v) { return std::fpclassify(v) == FP_SUBNORMAL; };
  for (const float first : {1e-3f, 1e-16f, 1e-18f, 3e-20f, 1e-22f, 1e-38f}) {
    std::vector<float> p = {1}, gradient;
    Adam adam(1, 0);
    for (int step = 0; step < 200'000; ++step) {
      gradient = {step == 0 ? first : 0};
      adam.step(p, gradient, 1e-3);
      if (subnormal(adam.first[0]) || subnormal(adam.second[0]))
        FAIL("gradient " << first << ", step " << step);
    }
    CHECK((adam.first[0] == 0 && adam.second[0] == 0));
  }
  std::vector<float> p = {1}, gradient = {NAN};
  Adam(1, 0).step(p, gradient, 1e-3);
  CHECK(std::isnan(p[0]));
}
