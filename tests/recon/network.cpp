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
TEST_CASE("matrix products equal plain sums with and without transposition") {
  const std::size_t m = GENERATE(1, 5), n = GENERATE(1, 7), k = 4;
  const auto ta = GENERATE(Transpose::no, Transpose::yes);
  const auto tb = GENERATE(Transpose::no, Transpose::yes);
  Rng rng = make_rng(8, 0);
  const auto a = normal(m * k, rng), b = normal(k * n, rng), before = normal(m * n, rng);
  auto c = before;
  multiply({m, n, k, ta, tb, 1.5, -2.0}, a.data(), b.data(), c.data());
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t j = 0; j < n; ++j) {
      double sum = -2 * before[i * n + j];
      for (std::size_t l = 0; l < k; ++l)
        sum += 1.5 * a[ta == Transpose::yes ? l * m + i : i * k + l] *
               b[tb == Transpose::yes ? j * k + l : l * n + j];
      CHECK(c[i * n + j] == Approx(sum).margin(1e-12));
    }
}

// The matrix sizes include those that occur when a model computes parts of a map.
TEST_CASE("products of a row vector and a matrix equal plain sums for any matrix size") {
  const std::size_t n = GENERATE(1, 2, 7, 48), k = GENERATE(1, 3, 4, 7, 61);
  const float beta = GENERATE(0.f, 1.f, -2.f);
  Rng rng = make_rng(9, 0);
  const auto a = normal(k, rng), b = normal(k * n, rng), before = normal(n, rng);
  const std::vector<float> x(a.begin(), a.end()), w(b.begin(), b.end());
  std::vector<float> y(before.begin(), before.end());
  multiply({1, n, k, Transpose::no, Transpose::no, 1.5f, beta}, x.data(), w.data(), y.data());
  for (std::size_t j = 0; j < n; ++j) {
    double sum = double{beta} * before[j];
    for (std::size_t l = 0; l < k; ++l) sum += 1.5 * a[l] * b[l * n + j];
    CHECK(double{y[j]} == Approx(sum).margin(1e-4));
  }
}

TEST_CASE("the forward pass of a network in single precision matches that in double precision") {
  const Problem q(5);
  Activations<double> a;
  forward(q.network, q.parameters, q.inputs.data(), q.batch, a);
  Activations<float> b;
  const std::vector<float> p(q.parameters.begin(), q.parameters.end());
  const std::vector<float> x(q.inputs.begin(), q.inputs.end());
  forward(q.network, p, x.data(), q.batch, b);
  for (std::size_t i = 0; i < a.back().size(); ++i)
    CHECK(double{b.back()[i]} == Approx(a.back()[i]).margin(1e-4));
}

TEST_CASE("the network of the reference paper has 1.37 million weights") {
  const Network n = make_network({365, 512, 256, 4096});
  CHECK(n.weights == 365 * 512 + 512 * 256 + 256 * 4096);
  CHECK(n.parameters == n.weights + 512 + 256 + 4096);
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

TEST_CASE(
    "moments of the Adam optimizer are never subnormal, and a NaN gradient gives a NaN weight") {
  for (const float first : {1e-3f, 1e-16f, 1e-18f, 3e-20f, 1e-22f, 1e-38f}) {
    std::vector<float> p = {1}, gradient;
    Adam adam(1, 0);
    for (int step = 0; step < 200'000; ++step) {
      gradient = {step == 0 ? first : 0};
      adam.step(p, gradient, 1e-3);
      if (std::fpclassify(adam.first[0]) == FP_SUBNORMAL ||
          std::fpclassify(adam.second[0]) == FP_SUBNORMAL) {
        FAIL("gradient " << first << ", step " << step);
      }
    }
    CHECK(adam.first[0] == 0);
    CHECK(adam.second[0] == 0);
  }
  std::vector<float> p = {1}, gradient = {NAN};
  Adam(1, 0).step(p, gradient, 1e-3);
  CHECK(std::isnan(p[0]));
}
