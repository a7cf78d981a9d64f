// SPDX-License-Identifier: MIT
#include "recon/study.hpp"

#include "drivers/core/exit_code.hpp"
#include "recon/train.hpp"

namespace echofuse::recon {

StudyModel::StudyModel(const std::string& text) : name(text), rung(text.substr(0, text.find(':'))) {
  if (rung.size() < text.size()) inputs = text.substr(rung.size() + 1);
  if (wants_readings(rung_of(rung, {}).model) && inputs_of(inputs) != Inputs::fused)
    throw Error(ExitCode::usage, "model \"" + text + "\": needs both sensors");
}

TrainedModel train_whole(const Dataset& data, const StudyModel& model, std::uint64_t seed,
                         bool fallback) {
  TrainOptions how;
  how.model = model.rung;
  how.inputs = model.inputs;
  how.fallback = fallback;
  how.split.test_share = 0;
  how.split.seed = how.fit.seed = seed;
  how.fit.quiet = true;
  return train(data, how);
}

MapScores mean_scores(const TrainedModel& model, const Dataset& data, const Rows& rows) {
  const Summaries summaries =
      summarise(score_maps(model.predict(data, rows), data, rows, model.scene));
  MapScores out{};
  for (std::size_t m = 0; m < metric_count; ++m) out[m] = summaries[m].mean;
  return out;
}

}  // namespace echofuse::recon
