// SPDX-License-Identifier: MIT
// Accuracy against cost: every model of a list, trained with several seeds on one run and judged on
// another; then how few photons and how few training records are enough.
#pragma once
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "recon/study/study.hpp"
#include "recon/use/evaluate.hpp"

namespace echofuse::recon {

struct ParetoOptions : StudyOptions {
  std::string train, test;  // run files
  // Candidates (models/model.hpp); ":spd" or ":radar" behind one leaves the other sensor out,
  // ":fused-profile" the radar's antennas. If the run has these, there is one with that behind each
  // model that takes them.
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
};

// Means over all seeds that were measured; `spread`: their standard deviation, NaN for one seed.
struct ParetoRow {
  std::string sweep, share, model;  // sweep: model, photons, records
  std::size_t seeds = 0;
  std::array<double, metric_count> mean{}, spread{};
  double multiply_adds = 0;
  bool timed = false;  // of the last measurement with times; maps are timed on one thread
  double infer_us_median = std::nan(""), infer_us_p99 = std::nan(""), train_s = std::nan("");
  bool front = false;  // of the models: none is both faster and more accurate (IoU)
};

// Measures what out/pareto.csv does not have yet; a row a model and share that the options name. A
// part takes no times, returns nothing, and leaves the last seed to the run that takes the parts.
// Throws Error(usage) for a model that is not known and for a study of other runs, Error(failed) if
// the runs do not fit, and as StudyFile.
std::vector<ParetoRow> study_pareto(const ParetoOptions& options);

// FOLDER/pareto.html. `bound`: nothing, or the least mean lateral errors that noise allows (m),
// pose unknown and shape known. Throws Error(disk).
void write_pareto_page(const std::vector<ParetoRow>& rows, const std::string& folder,
                       const std::vector<double>& bound);
std::string to_text(const std::vector<ParetoRow>& rows);

}  // namespace echofuse::recon
