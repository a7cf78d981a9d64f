// SPDX-License-Identifier: MIT
#include "recon/train/choice.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "drivers/util/console.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t folds = 4;
// Weight of the lateral error relative to IoU, 1/m. For one model, the IoU is .671 in the quarter
// of the records with the smallest lateral errors (0.5 cm), and .510 in the quarter with the
// largest (7.3 cm). This corresponds to a slope of 2.4 per metre.
constexpr double iou_a_metre = 2.4;
constexpr std::uint64_t fold_stream = 0x74756e65;  // "tune" in ASCII

}  // namespace

Choice::Choice(const SceneModel& assessed_by, const Split& split, const SplitOptions& options)
    : assessed_by_(assessed_by),
      split_(split),
      sequence_(options.kind == "blocked"),
      folds_(make_folds(split.train, folds, options, fold_stream)) {}

void Choice::add(const std::string& name, const Dataset& data, Fit fit) {
  Alternative& entry = entries_.emplace_back(Alternative{{{name, {}}, {}, 0, {}}, std::move(fit)});
  Folds scores;
  const auto started = std::chrono::steady_clock::now();
  for (const Split& fold : folds_) {
    entry.models.push_back(entry.fit(fold.train));
    const Estimator& model = entry.models.back();
    scores.push_back(score_maps(model.maps(data, fold.test), data, fold.test, assessed_by_));
    if (interrupted()) throw Error(ExitCode::interrupted, "interrupted during cross-validation");
  }
  entry.row.metrics = summarise(scores, sequence_);
  for (const auto& fold : scores)
    for (const MapScores& map : fold)
      entry.score.push_back(assessed_by_.has_body()
                                ? map[metric_iou] - iou_a_metre * map[metric_lateral_m]
                                : -map[metric_rmse_m]);
  entry.row.cost = entry.models.front().cost();
  entry.row.train_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count() / folds;
}

void Choice::choose(double errors) {
  chosen_ = 0;
  double best_gain = 0;
  for (std::size_t i = 1; i < entries_.size(); ++i)
    if (const auto [gain, error] = gain_and_error(entries_[i], entries_.front());
        gain > std::max(best_gain, errors * error))
      chosen_ = i, best_gain = gain;
}

std::pair<double, double> Choice::gain_over(std::size_t first, std::size_t last) const {
  auto smallest = gain_and_error(entries_[chosen_], entries_[first]);
  while (++first < last)
    smallest = std::min(smallest, gain_and_error(entries_[chosen_], entries_[first]));
  return smallest;
}

std::vector<CrossvalidatedRow> Choice::table() const {
  std::vector<CrossvalidatedRow> out;
  for (const Alternative& e : entries_) out.push_back(e.row);
  return out;
}

std::vector<HeldOut> Choice::held_out() const {
  std::vector<HeldOut> out;
  for (std::size_t k = 0; k < folds; ++k)
    out.push_back({entries_[chosen_].models[k], folds_[k].test});
  return out;
}

// Returns the mean gain and its standard error, from paired differences, because both candidates
// were tested on the same records in the same folds.
std::pair<double, double> Choice::gain_and_error(const Alternative& entry,
                                                 const Alternative& than) {
  std::vector<double> gains;
  for (std::size_t i = 0; i < entry.score.size(); ++i)
    if (const double gain = entry.score[i] - than.score[i]; !std::isnan(gain))
      gains.push_back(gain);
  if (gains.size() < 2) return {0, 0};
  return {mean_of(gains),
          standard_deviation(gains) / std::sqrt(static_cast<double>(gains.size() - 1))};
}

}  // namespace echofuse::recon
