// SPDX-License-Identifier: MIT
// bench_recon RUN: reconstruction's speed on a run of the base condition, each beside what limits
// it: training beside the machine's best matrix product, one map of the plain network beside the
// reading of its weights. Best of some rounds, by the clock on the wall.
#include <cblas.h>

#include <chrono>
#include <cstdio>
#include <limits>

#include "recon/estimator/trained_model.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/parallel.hpp"

using namespace echofuse;
using namespace echofuse::recon;

namespace {

template <class Work>
double best_s(int rounds, const Work& work) {
  double best = std::numeric_limits<double>::max();
  for (int i = 0; i < rounds; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
    best = std::min(best, took.count());
  }
  return best;
}

// Multiply-adds a second of large square products.
double peak() {
  constexpr std::size_t n = 2048;
  const std::vector<float> a(n * n, 0.5f), b(n * n, 0.25f);
  std::vector<float> c(n * n);
  const double s = best_s(5, [&] { multiply({n, n, n}, a.data(), b.data(), c.data()); });
  return static_cast<double>(n * n * n) / s;
}

TrainedModel fitted(const Dataset& data, const std::string& model, std::size_t epochs) {
  FitOptions fit;
  fit.quiet = true, fit.epochs = epochs, fit.patience = epochs;
  const Split split = make_split(data.usable(Inputs::fused), {});
  const Preprocessing preprocessing(data, split.train, Inputs::fused,
                                    learn_scene(data.depth, split.train, data.map),
                                    wants_alignment(candidate_of(model, fit).model));
  return fit_model(data, split, preprocessing, model, Inputs::fused, "record", fit);
}

// An epoch is the difference between a training of one and of three.
void training(const Dataset& data) {
  const std::size_t records = make_split(data.usable(Inputs::fused), {}).train.size();
  for (const int threads : {1, 2}) {
    set_threads(threads);
    const double most = peak();
    std::size_t multiply_adds = 0;
    const auto run = [&](std::size_t epochs) {
      return best_s(3, [&] {
        const TrainedModel m = fitted(data, "mlp-512-256", epochs);
        // Forward, and backward to the weights and to the layer below, but for the inputs.
        const std::size_t first_product =
            (data.spd_axis.count + data.radar_axis.count) * m.fit.hidden.value().front();
        multiply_adds = 3 * m.model->cost().multiply_adds - first_product;
      });
    };
    const double once = run(1), epoch = (run(3) - once) / 2;
    const double done = static_cast<double>(multiply_adds * records) / epoch;
    std::printf(
        "training mlp-512-256, %d thread%s: %.2f s an epoch of %zu records (with validation), "
        "%.0f of at most %.0f GFLOP/s: %.0f %%\n",
        threads, threads > 1 ? "s" : "", epoch, records, 2e-9 * done, 2e-9 * most,
        100 * done / most);
  }
}

// Of one map as `evaluate` times it: scaling and prediction.
void one_map(const Dataset& data, const std::string& name) {
  set_threads(1);
  const TrainedModel m = fitted(data, name, 1);
  std::size_t row = 0;
  const double us = 1e6 * best_s(400, [&] { m.predict(data, {row++ % data.size()}); });
  const std::vector<float> weights(m.model->cost().parameters, 1.f);
  const auto n = static_cast<int>(weights.size());
  float sum = 0;
  const double reading_us =
      1e6 * best_s(400, [&] { sum += cblas_sdot(n, weights.data(), 1, weights.data(), 1); });
  std::printf("one map of %-14s %5.1f us; its %.2f MB of weights are read in %.1f us\n",
              name.c_str(), us, 4e-6 * n, sum > 0 ? reading_us : 0);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fputs("usage: bench_recon RUN\n", stderr), 2;
  Dataset data;
  const double loading = best_s(3, [&] { data = load({argv[1]}); });
  std::printf("loading %zu records: %.2f s\n", data.size(), loading);
  training(data);
  for (const char* name : {"mlp-512-256", "factorised-16"}) one_map(data, name);
  for (const int threads : {1, 2}) {
    set_threads(threads);
    for (const char* name : {"mlp-512-256", "factorised-16"}) {
      const TrainedModel m = fitted(data, name, 1);
      const Rows rows = all_rows(data.size());
      std::printf("all %zu maps of %-14s %.2f s, %d thread(s)\n", rows.size(), name,
                  best_s(3, [&] { m.predict(data, rows); }), threads);
    }
  }
}
