// SPDX-License-Identifier: MIT
#include "recon/train/crossvalidate.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/util/console.hpp"
#include "drivers/util/exit_code.hpp"
#include "drivers/util/format.hpp"

namespace echofuse::recon {

Summaries summarise(const Folds& folds, bool sequence) {
  std::vector<MapScores> all;
  for (const auto& fold : folds) all.insert(all.end(), fold.begin(), fold.end());
  Summaries out = summarise(all);
  for (std::size_t m = 0; m < metric_count && sequence; ++m) {
    double squares = 0, defined = 0;  // defined: number of folds in which the metric is defined
    for (const auto& fold : folds) {
      double rest = 0;
      std::size_t maps = 0;
      for (const MapScores& scores : fold)
        if (!std::isnan(scores[m])) rest += scores[m] - out[m].mean, ++maps;
      squares += rest * rest;
      defined += maps > 0;
    }
    out[m].se = defined > 1 ? std::sqrt(defined / (defined - 1) * squares) /
                                  static_cast<double>(out[m].maps)
                            : std::nan("");
  }
  return out;
}

std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const TrainOptions& options) {
  constexpr std::size_t folds = 4;
  const Inputs inputs = inputs_of(options.inputs);
  const bool sequence = options.split.kind == "blocked";
  const auto names =
      options.candidates.empty() ? candidates(shows_sides(data, inputs)) : options.candidates;
  FitOptions fit = options.fit;
  fit.quiet = true;
  const bool aligned = std::any_of(names.begin(), names.end(), [&](const auto& name) {
    return wants_alignment(candidate_of(name, fit).model);
  });
  std::vector<CrossvalidatedRow> out;
  for (const auto& name : names) out.push_back({{name, {}}, {}, 0, {}});
  std::vector<Folds> scores(names.size());
  const SceneModel scoring = learn_scene(data.depth(), rows, data.map);
  Progress progress("cross-validation", folds * names.size(), options.fit.quiet);
  for (std::size_t fold = 0; fold < folds; ++fold) {
    const Split split = make_fold(rows, fold, folds, sequence ? options.split.gap : 0);
    const Preprocessing preprocessing(data, split.train, inputs,
                                      learn_scene(data.depth(), split.train, data.map), aligned,
                                      options.background);
    for (std::size_t m = 0; m < out.size(); ++m) {
      if (interrupted()) throw Error(ExitCode::interrupted, "interrupted during cross-validation");
      if (out[m].fault.empty()) try {
          const Estimator model =
              fit_model(data, split, preprocessing, names[m], inputs, options.scaling, fit);
          scores[m].push_back(score_maps(model.maps(data, split.test), data, split.test, scoring));
          out[m].cost = model.cost(), out[m].train_s += model.train_s / folds;
        } catch (const Error& error) {
          if (error.code() != ExitCode::failed) throw;
          out[m].fault = error.what();
          scores[m].clear();
        }
      progress.update(fold * out.size() + m + 1, out[m].name);
    }
  }
  for (std::size_t m = 0; m < out.size(); ++m) out[m].metrics = summarise(scores[m], sequence);
  return out;
}

std::vector<std::string> candidates(bool shows_sides) {
  std::vector<std::string> out = {"empty", "mean"};
  if (shows_sides)
    for (const char* name :
         {"mean-shape", "factorised-4", "factorised-10", "factorised-16", "factorised-32"})
      out.emplace_back(name);
  for (const char* name : {"ridge", "pca-mlp-256-256", "mlp-512-256", "nearest"})
    out.emplace_back(name);
  return out;
}

std::string usual_model(bool shows_sides) { return shows_sides ? "factorised" : "pca-mlp-256-256"; }

std::size_t cheapest_within_one_se(const std::vector<CrossvalidatedRow>& rows) {
  std::size_t best = rows.size();
  const bool by_iou = std::ranges::any_of(
      rows, [](const auto& row) { return !std::isnan(row.metrics[metric_iou].mean); });
  const auto quality = [&](std::size_t i) {
    const auto& m = rows[i].metrics;
    return by_iou ? m[metric_iou].mean : -m[metric_rmse_m].mean;
  };
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (!std::isnan(quality(i)) && (best == rows.size() || quality(i) > quality(best))) best = i;
  if (best == rows.size())
    throw Error(ExitCode::failed, "no candidate could be tested: " + rows.front().fault);
  const double enough = quality(best) - rows[best].metrics[by_iou ? metric_iou : metric_rmse_m].se;
  std::size_t chosen = best;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (quality(i) >= enough && rows[i].cost.multiply_adds < rows[chosen].cost.multiply_adds)
      chosen = i;
  return chosen;
}

std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen) {
  std::string out = format("%-18s %15s %8s %8s %9s %8s %12s %8s\n", "model", "IoU", "SSIM_fg",
                           "SSIM", "lateral m", "RMSE m", "multiply-adds", "train s");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto mean = [&](Metric metric) {
      return formatted(Summary{rows[i].metrics[metric].mean, std::nan(""), 0}, "");
    };
    out +=
        format("%-18s %15s %8s %8s %9s %8s %12zu %8.1f %s\n", rows[i].name.c_str(),
               formatted(rows[i].metrics[metric_iou], " +-").c_str(), mean(metric_ssim_fg).c_str(),
               mean(metric_ssim).c_str(), mean(metric_lateral_m).c_str(),
               mean(metric_rmse_m).c_str(), rows[i].cost.multiply_adds, rows[i].train_s,
               i == chosen ? " <- chosen" : rows[i].fault.c_str());
  }
  return out;
}

}  // namespace echofuse::recon
