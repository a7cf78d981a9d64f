// SPDX-License-Identifier: MIT
// Accuracy against cost: every model of a list, trained with several seeds on one run and judged on
// another; then how few photons and how few training records are enough.
#pragma once
#include <array>
#include <optional>
#include <string>
#include <vector>

#include "recon/estimator/evaluate.hpp"

namespace echofuse::recon {

struct ParetoOptions {
  std::string train, test, out;  // run files; folder for pareto.csv, pareto.svg and pareto.gp
  // Candidates (models/model.hpp); ":spd" or ":radar" behind one leaves the other sensor out.
  std::vector<std::string> models = {"empty",           "mean",
                                     "nearest",         "ridge",
                                     "silhouette",      "factorised-4",
                                     "factorised-10",   "factorised-16",
                                     "factorised-32",   "pca-mlp-256-256",
                                     "mlp-512-256",     "mlp-1024-512-256",
                                     "mlp-512-256:spd", "mlp-512-256:radar"};
  std::vector<std::string> sweep_models = {"nearest", "silhouette", "factorised-16", "mlp-512-256"};
  // Shares of the photons (their counts thinned, in training and test alike) and of the training
  // records. None: no such sweep.
  std::vector<double> photons = {0.1, 0.01, 0.001}, records = {0.05, 0.2, 0.5};
  std::size_t seeds = 3;
  int threads = 0;  // while training; maps are timed on one
  bool quiet = false;
};

// Means over the seeds; `spread`: their standard deviation, NaN for one seed.
struct ParetoRow {
  std::string sweep;  // model, photons, records
  double share = 1;
  std::string model;
  std::size_t seeds = 0;
  std::array<double, metric_count> mean{}, spread{};
  RunningCost cost;    // of the last seed
  bool front = false;  // of the models: none is both faster and more accurate (IoU)
};

// Every row is written to out/pareto.csv as soon as it is measured. Rows that are there already, of
// the same runs (out/pareto.runs) and as many seeds, are not measured again. Throws Error(usage)
// for a model that is not known and for a folder with a study of other runs, Error(failed) if the
// runs do not fit.
std::vector<ParetoRow> study_pareto(const ParetoOptions& options);

// pareto.csv as it is while the study goes on: empty if there is none. Throws Error(failed) for a
// damaged one.
std::vector<ParetoRow> read_pareto(const std::string& folder);
void write_pareto_table(const std::vector<ParetoRow>& rows, const std::string& folder);

// The least mean lateral error that noise allows, at the base condition (m).
struct LateralBound {
  double shape_known_m = 0, pose_unknown_m = 0;
};
// Of the table that `echofuse-sim study bound` writes. Throws Error(failed).
LateralBound read_bound(const std::string& path);

// Table and chart. Throws Error(disk), and Error(failed) without gnuplot; the table is written
// first.
void write_pareto(const std::vector<ParetoRow>& rows, const std::string& folder,
                  const std::optional<LateralBound>& bound = {});
std::string to_text(const std::vector<ParetoRow>& rows);

}  // namespace echofuse::recon
