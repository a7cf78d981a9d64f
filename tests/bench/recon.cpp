// SPDX-License-Identifier: MIT
// bench_recon RUN: benchmark of the reconstruction of a run on one thread. Each part is compared
// with its limit. The limit of training is the processor's rate of multiply-adds, that of a map is
// the time to read the weights, and that of loading is the time to read the file.
#include <cstdio>
#include <filesystem>

#include "../fixtures/dataset.hpp"
#include "limits.hpp"
#include "recon/data/exclusion.hpp"
#include "recon/numbers/blas.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/predict/estimator.hpp"

using namespace echofuse;
using namespace echofuse::bench;
using namespace echofuse::recon;
using namespace echofuse::test;

namespace {

Estimator fitted(const Dataset& data, const std::string& model, std::size_t epochs) {
  FitOptions fit;
  fit.quiet = true, fit.epochs = epochs, fit.patience = epochs;
  const Split split = make_split(usable(data, Inputs::fused), {});
  const Preprocessing preprocessing(data, split.train, Inputs::fused,
                                    learn_scene(depth_maps(data), split.train, data.map),
                                    wants_alignment(candidate_of(model, fit).model));
  return fit_model(data, split, preprocessing, model, Inputs::fused, "record", fit);
}

// Measures the duration of one epoch with validation. This is an eighth of the difference between
// the durations of nine epochs and of one epoch.
void training(const Dataset& data, double max_per_s) {
  const Split split = make_split(usable(data, Inputs::fused), {});
  std::size_t a_record = 0, a_judgement = 0;
  const auto run = [&](std::size_t epochs) {
    return best_s(4, [&] {
      const Estimator m = fitted(data, "mlp-512-256", epochs);
      // Counts the multiply-adds of the forward and backward passes, without the gradient with
      // respect to the inputs.
      a_judgement = m.model->cost().multiply_adds;
      a_record = 3 * a_judgement - m.features.count() * m.fit.hidden.value().front();
    });
  };
  const double once = run(1), epoch = (run(9) - once) / 8;
  const auto done =
      static_cast<double>(a_record * split.train.size() + a_judgement * split.validation.size());
  // The limit is the higher of two rates, measured before and after the training runs, because the
  // speed of a shared machine varies.
  print_row("training of the plain network", "GFLOP/s", 2e-9 * done / epoch,
            2e-9 * std::max(max_per_s, multiply_adds_per_s()), "multiply-adds");
}

// Measures the time that `evaluate` takes for one map, including the alignment or scaling of the
// inputs.
void one_map(const Dataset& data, const std::string& name) {
  const Estimator m = fitted(data, name, 1);
  std::size_t row = 0;
  // Each measurement covers several maps, because reading the processor clock is a system call.
  constexpr int at_once = 100;
  const double us = 1e6 / at_once * best_s(40, [&] {
                      for (int i = 0; i < at_once; ++i) m.maps(data, {row++ % data.size()});
                    });
  const std::size_t bytes = m.model->cost().parameters * sizeof(float);
  print_row(("one map of " + name).c_str(), "us", us,
            1e6 * static_cast<double>(bytes) / bytes_read_per_s(bytes), "reading its weights");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fputs("usage: bench_recon RUN\n", stderr), 2;
  set_threads(1);
  constexpr std::size_t large = std::size_t{1} << 28;
  const double max_per_s = multiply_adds_per_s(), read_per_s = bytes_read_per_s(large);
  std::printf("this machine, one thread (%s): %.0f GFLOP/s, reads %.1f GB/s\n", instructions(),
              2e-9 * max_per_s, 1e-9 * read_per_s);
  std::printf("matrix kernels: %s (%s)\n", blas_kernels().c_str(), blas_instructions().c_str());
  Dataset data;
  const double loading = 1e6 * best_s(3, [&] { data = load({argv[1]}); });
  const auto records = static_cast<double>(data.size());
  print_row("loading a record", "us", loading / records,
            1e6 * static_cast<double>(std::filesystem::file_size(argv[1])) / read_per_s / records,
            "reading the file");
  training(data, max_per_s);
  for (const char* name : {"mlp-512-256", "factorised-32", "factorised-16"}) one_map(data, name);
}
