// SPDX-License-Identifier: MIT
#include "recon/train/crossvalidate.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "drivers/program/console.hpp"
#include "drivers/program/exit_code.hpp"
#include "recon/numbers/text.hpp"

namespace echofuse::recon {
namespace {

constexpr std::uint64_t fold_stream = 0x666f6c64;  // "fold"

}  // namespace

Summaries summarise(const Folds& folds, bool sequence) {
  std::vector<MapScores> all;
  for (const auto& fold : folds) all.insert(all.end(), fold.begin(), fold.end());
  Summaries out = summarise(all);
  for (std::size_t m = 0; m < metric_count && sequence; ++m) {
    double squares = 0, defined = 0;  // folds with a map that defines the metric
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

Crossvalidation::Crossvalidation(const Scene& judged_by, const Rows& rows,
                                 const SplitOptions& options, std::uint64_t stream)
    : judged_by_(judged_by),
      folds_(make_folds(rows, 4, options, stream)),
      sequence_(options.kind == "blocked") {}

CrossvalidatedRow Crossvalidation::row(const std::string& name, const Dataset& data,
                                       const std::function<Estimator(const Split& fold)>& fit,
                                       std::vector<Estimator>* models) const {
  CrossvalidatedRow out{{name, {}}, {}, 0, {}};
  Folds scores;
  for (const Split& fold : folds_) {
    if (interrupted()) throw Error(ExitCode::interrupted, "interrupted while choosing");
    try {
      const auto started = std::chrono::steady_clock::now();
      Estimator model = fit(fold);
      const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - started;
      out.train_s += taken.count() / static_cast<double>(folds_.size());
      out.cost = model.cost();
      scores.push_back(score_maps(model.maps(data, fold.test), data, fold.test, judged_by_));
      if (models) models->push_back(std::move(model));
    } catch (const Error& error) {
      if (error.code() != ExitCode::failed) throw;
      out.fault = error.what();
      scores.clear();
      break;
    }
  }
  out.metrics = summarise(scores, sequence_);
  for (const auto& fold : scores) out.scores.insert(out.scores.end(), fold.begin(), fold.end());
  return out;
}

std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const TrainOptions& options) {
  const Inputs inputs = inputs_of(options.inputs);
  const auto names = options.candidates.empty() ? candidates(inputs) : options.candidates;
  FitOptions fit = options.fit;
  fit.quiet = true;
  const Scene judge = learn_scene(data.depth, rows, data.map);
  const Crossvalidation folds(judge, rows, options.split, fold_stream);
  Progress progress("cross-validation", names.size(), options.fit.quiet);
  std::vector<CrossvalidatedRow> out;
  for (const std::string& name : names) {
    out.push_back(folds.row(name, data, [&](const Split& fold) {
      const Preprocessing preprocessing(
          data, fold.train, inputs, learn_scene(data.depth, fold.train, data.map),
          wants_alignment(candidate_of(name, fit).model), options.config);
      return fit_model(data, fold, preprocessing, name, inputs, options.scaling, fit);
    }));
    progress.update(out.size(), name);
  }
  return out;
}

std::vector<std::string> candidates(Inputs inputs) {
  std::vector<std::string> out = {"empty", "mean"};
  if (both_sensors(inputs))
    for (const char* name :
         {"silhouette", "factorised-4", "factorised-10", "factorised-16", "factorised-32"})
      out.emplace_back(name);
  for (const char* name : {"ridge", "pca-mlp-256-256", "mlp-512-256", "nearest"})
    out.emplace_back(name);
  return out;
}

std::string usual_model(Inputs inputs) {
  return both_sensors(inputs) ? "factorised" : "pca-mlp-256-256";
}

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
    throw Error(ExitCode::failed, "no model can be judged: " + rows.front().fault);
  const double enough = quality(best) - rows[best].metrics[by_iou ? metric_iou : metric_rmse_m].se;
  std::size_t chosen = best;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (quality(i) >= enough && rows[i].cost.multiply_adds < rows[chosen].cost.multiply_adds)
      chosen = i;
  return chosen;
}

std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen) {
  std::size_t width = 18;
  for (const CrossvalidatedRow& row : rows) width = std::max(width, row.name.size());
  std::string out =
      formatted("%-*s %15s %8s %8s %15s %8s %12s %8s\n", static_cast<int>(width), "model", "IoU",
                "SSIM_fg", "SSIM", "lateral m", "RMSE m", "multiply-adds", "train s");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto mean = [&](Metric metric) {
      return formatted(Summary{rows[i].metrics[metric].mean, std::nan(""), 0}, "");
    };
    out += formatted("%-*s %15s %8s %8s %15s %8s %12zu %8.2f %s\n", static_cast<int>(width),
                     rows[i].name.c_str(), formatted(rows[i].metrics[metric_iou], " +-").c_str(),
                     mean(metric_ssim_fg).c_str(), mean(metric_ssim).c_str(),
                     formatted(rows[i].metrics[metric_lateral_m], " +-").c_str(),
                     mean(metric_rmse_m).c_str(), rows[i].cost.multiply_adds, rows[i].train_s,
                     i == chosen ? " <- chosen" : rows[i].fault.c_str());
  }
  return out;
}

}  // namespace echofuse::recon
