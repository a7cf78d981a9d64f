// SPDX-License-Identifier: MIT
#include "recon/train.hpp"

#include <algorithm>
#include <cstdio>

#include "drivers/core/random.hpp"
#include "recon/crossvalidate.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t auto_folds = 4;
constexpr std::uint64_t fold_stream = 0x666f6c64;  // "fold"

// Judged on the training records alone: the test records choose nothing.
std::string choose(const Dataset& data, const Split& split, const TrainOptions& options) {
  Rows rows = split.train;
  rows.insert(rows.end(), split.validation.begin(), split.validation.end());
  std::sort(rows.begin(), rows.end());
  const bool blocked = options.split.kind == "blocked";
  Rng rng = make_rng(options.split.seed, fold_stream);
  if (!blocked) std::shuffle(rows.begin(), rows.end(), rng);
  CrossvalidateOptions cross{
      options.inputs, options.scaling, options.ladder, auto_folds, blocked ? options.split.gap : 0,
      options.fit};
  if (cross.models.empty()) cross.models = ladder(inputs_of(options.inputs));
  const auto table = crossvalidate(data, rows, cross);
  const std::size_t chosen = cheapest_within_one_se(table);
  if (!options.fit.quiet) std::fputs(to_choice_table(table, chosen).c_str(), stderr);
  return table[chosen].name;
}

}  // namespace

TrainedModel train(const Dataset& data, const TrainOptions& options) {
  const Inputs inputs = inputs_of(options.inputs);
  const Split split = make_split(data.usable(inputs), options.split);
  const std::string name = options.model == "auto" ? choose(data, split, options) : options.model;
  TrainedModel model = fit_model(data, split, name, inputs, options.scaling, options.fit);
  model.split = options.split;
  return model;
}

}  // namespace echofuse::recon
