// SPDX-License-Identifier: MIT
#include "recon/estimator/crossvalidate.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "drivers/core/console.hpp"
#include "drivers/core/exit_code.hpp"
#include "drivers/core/printable.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

// The rows of `maps` that hold the same records as `rows` of `data`.
Matrix published_maps(const Dataset& data, const Rows& rows, const Dataset& published) {
  Matrix out(0, data.depth.cols);
  for (const std::size_t row : rows) {
    const auto found = std::find(published.index.begin(), published.index.end(), data.index[row]);
    const auto at = static_cast<std::size_t>(found - published.index.begin());
    if (found == published.index.end() || !published.has(at, Sensor::depth))
      throw Error(ExitCode::failed, published.sources.front().path + ": no depth map for record " +
                                        std::to_string(data.index[row]));
    out.add_row(published.depth.row(at));
  }
  return out;
}

std::vector<MapScores> all_of(const Folds& folds) {
  std::vector<MapScores> all;
  for (const auto& fold : folds) all.insert(all.end(), fold.begin(), fold.end());
  return all;
}

}  // namespace

Summaries summarise_folds(const Folds& folds) {
  Summaries out = summarise(all_of(folds));
  for (std::size_t m = 0; m < metric_count; ++m) {
    double squares = 0, defined = 0;  // folds with a map that defines it
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

Summaries summarise(const Folds& folds, bool sequence) {
  return sequence ? summarise_folds(folds) : summarise(all_of(folds));
}

std::vector<CrossvalidatedRow> crossvalidate(const Dataset& data, const Rows& rows,
                                             const CrossvalidateOptions& options,
                                             const Dataset& published) {
  const Inputs inputs = inputs_of(options.inputs);
  std::vector<CrossvalidatedRow> out;
  std::vector<Folds> scores(options.models.size());
  for (const auto& name : options.models) out.push_back({{name, {}}, {}, 0, {}});
  Folds published_scores;
  require_map(published, data.map, "what it is compared with");
  Progress progress("cross-validation", options.folds * options.models.size(), options.fit.quiet);
  FitOptions fit = options.fit;
  fit.quiet = true;
  const bool aligned =
      std::any_of(options.models.begin(), options.models.end(),
                  [&](const auto& name) { return wants_alignment(candidate_of(name, fit).model); });
  std::vector<double> measured(out.size());
  for (std::size_t fold = 0; fold < options.folds && !interrupted(); ++fold) {
    const Split split = make_fold(rows, fold, options.folds, options.gap);
    std::optional<Preprocessing> made;  // takes a while, and not every process needs it
    std::optional<Plates> plates;
    const auto preprocessing = [&]() -> const Preprocessing& {
      if (!made)
        made.emplace(data, split.train, inputs, learn_scene(data.depth, split.train, data.map),
                     aligned);
      return *made;
    };
    const auto scores_of = [&](const Matrix& maps) {
      const Scene& scene = preprocessing().scene;
      if (!plates) plates = options.letters ? find_plates(data, split.test, scene) : Plates{};
      return score_maps(maps, data, split.test, scene, *plates);
    };
    const auto measure = [&](std::size_t m) {
      const TrainedModel model =
          fit_model(data, split, preprocessing(), options.models[m], inputs, options.scaling, fit);
      out[m].train_s += model.train_s, ++measured[m];
      return FoldScores{scores_of(model.predict(data, split.test)), model.cost()};
    };
    for (std::size_t m = 0; m < out.size() && !interrupted(); ++m) {
      if (out[m].fault.empty()) try {
          const SharedFolds* const shared = options.shared;
          const FoldScores* const known = shared ? shared->known(fold, m) : nullptr;
          const bool fits = known && known->maps.size() == split.test.size();
          if (!fits && shared && !shared->mine(fold, m)) continue;
          const FoldScores found = fits ? *known : measure(m);
          if (!fits && shared) shared->keep(fold, m, found);
          scores[m].push_back(found.maps);
          out[m].cost = found.cost;
        } catch (const Error& error) {
          if (error.code() != ExitCode::failed) throw;
          out[m].fault = error.what();
          scores[m].clear();
        }
      progress.update(fold * out.size() + m + 1, out[m].name);
    }
    if (published.size() > 0)
      published_scores.push_back(scores_of(published_maps(data, split.test, published)));
  }
  if (interrupted()) throw Error(ExitCode::interrupted, "interrupted during the cross-validation");
  for (std::size_t m = 0; m < out.size(); ++m) {
    out[m].train_s = measured[m] > 0 ? out[m].train_s / measured[m] : std::nan("");
    out[m].metrics = summarise(scores[m], options.sequence);
  }
  if (published.size() > 0)
    out.push_back({{"published", summarise(published_scores, options.sequence)}, {}, 0, {}});
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
  const auto iou = [&](std::size_t i) { return rows[i].metrics[metric_iou]; };
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (!std::isnan(iou(i).mean) && (best == rows.size() || iou(i).mean > iou(best).mean)) best = i;
  if (best == rows.size())
    throw Error(ExitCode::failed,
                "no model can be judged: " + (rows.front().fault.empty()
                                                  ? "the maps show nothing before the background"
                                                  : rows.front().fault));
  const double enough = iou(best).mean - iou(best).se;
  std::size_t chosen = best;
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (iou(i).mean >= enough && rows[i].cost.multiply_adds < rows[chosen].cost.multiply_adds)
      chosen = i;
  return chosen;
}

bool all_fitted(const std::vector<CrossvalidatedRow>& rows) {
  bool all = true;
  for (const auto& row : rows) {
    if (row.fault.empty()) continue;
    std::fprintf(stderr, "%s: %s\n", row.name.c_str(), printable(row.fault).c_str());
    all = false;
  }
  return all;
}

std::string to_choice_table(const std::vector<CrossvalidatedRow>& rows, std::size_t chosen) {
  std::string out = formatted("%-18s %15s %8s %8s %9s %8s %12s %8s\n", "model", "IoU", "SSIM_fg",
                              "SSIM", "lateral m", "RMSE m", "multiply-adds", "train s");
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto& m = rows[i].metrics;
    out += formatted("%-18s %15s %8.3f %8.3f %9.3f %8.3f %12zu %8.1f %s\n", rows[i].name.c_str(),
                     formatted(m[metric_iou], " +-").c_str(), m[metric_ssim_fg].mean,
                     m[metric_ssim].mean, m[metric_lateral_m].mean, m[metric_rmse_m].mean,
                     rows[i].cost.multiply_adds, rows[i].train_s,
                     i == chosen ? " <- chosen" : rows[i].fault.c_str());
  }
  return out;
}

}  // namespace echofuse::recon
