// SPDX-License-Identifier: MIT
#include "recon/crossvalidate.hpp"

#include <algorithm>

#include "drivers/core/exit_code.hpp"
#include "recon/train.hpp"

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

}  // namespace

std::vector<ScoredRow> crossvalidate(const Dataset& data, const CrossvalidateOptions& options,
                                     const Dataset& published) {
  const Inputs inputs = inputs_of(options.inputs);
  const Rows rows = rows_to_train(data, inputs);
  std::vector<std::vector<MapScores>> scores(options.models.size());
  std::vector<MapScores> published_scores;
  for (std::size_t fold = 0; fold < options.folds; ++fold) {
    const Split split = make_fold(rows, fold, options.folds, options.gap);
    const Scene scene = learn_scene(data.depth, split.train);
    const auto add = [&](std::vector<MapScores>& to, const Matrix& maps) {
      const auto more = score_maps(maps, data, split.test, scene);
      to.insert(to.end(), more.begin(), more.end());
    };
    for (std::size_t m = 0; m < options.models.size(); ++m)
      add(scores[m], fit_model(data, split, options.models[m], inputs, options.scaling, options.fit)
                         .predict(data, split.test));
    if (published.size() > 0) add(published_scores, published_maps(data, split.test, published));
  }
  std::vector<ScoredRow> out;
  for (std::size_t m = 0; m < options.models.size(); ++m)
    out.push_back({options.models[m], summarise(scores[m])});
  if (published.size() > 0) out.push_back({"published", summarise(published_scores)});
  return out;
}

}  // namespace echofuse::recon
