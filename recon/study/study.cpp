// SPDX-License-Identifier: MIT
#include "recon/study/study.hpp"

#include <algorithm>

#include "drivers/program/exit_code.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {

std::string joined(const std::vector<std::string>& texts, const char* between) {
  std::string out;
  for (const auto& text : texts) out += (&text == texts.data() ? "" : between) + text;
  return out;
}

StudyModel::StudyModel(const std::string& text)
    : name(text), candidate(text.substr(0, text.find(':'))) {
  if (candidate.size() < text.size()) inputs = text.substr(candidate.size() + 1);
  const Inputs wanted = inputs_of(inputs);
  if (wants_alignment(candidate_of(candidate, {}).model) && !both_sensors(wanted))
    throw Error(ExitCode::usage, "model \"" + text + "\": needs both sensors");
}

bool is_network(const StudyModel& model) {
  return candidate_of(model.candidate, {}).fit.hidden.has_value();
}

std::vector<std::string> with_profiles(const std::vector<std::string>& models) {
  std::vector<std::string> out;
  for (const auto& name : models) {
    out.push_back(name);
    const StudyModel model(name);
    const std::string of_profile = model.candidate + ":" + name_of(Inputs::fused_profile);
    const bool known = std::find(models.begin(), models.end(), of_profile) != models.end();
    if (model.inputs == name_of(Inputs::fused) && !known &&
        wants_alignment(candidate_of(model.candidate, {}).model))
      out.push_back(of_profile);
  }
  return out;
}

TrainedModel train_on_all(const Dataset& data, const StudyModel& model, std::uint64_t seed,
                          bool with_parts) {
  TrainOptions how;
  how.model = model.candidate;
  how.inputs = model.inputs;
  how.split.test_share = 0;
  how.split.seed = how.fit.seed = seed;
  how.fit.quiet = true;
  how.fallback = with_parts;
  // It takes long to learn.
  how.uncertainty = with_parts && wants_alignment(candidate_of(model.candidate, {}).model);
  return train(data, how);
}

Matrix predict_or_empty_room(const TrainedModel& model, const Records& records, const Rows& rows) {
  Matrix maps(0, model->scene.background.size());
  for (std::size_t row = 0; row < records.data.size(); ++row) maps.add_row(model->scene.background);
  const Matrix made =
      predict(model, records, rows,
              model->uncertainty ? PredictionDetail::uncertainty : PredictionDetail::maps)
          .maps;
  for (std::size_t i = 0; i < rows.size(); ++i)
    std::copy_n(made.row(i).begin(), maps.cols, maps.row(rows[i]).begin());
  return maps;
}

MapScores mean_scores(const Matrix& maps, const Dataset& data, const Rows& rows,
                      const Scene& scene) {
  const Summaries summaries = summarise(score_maps(maps, data, rows, scene));
  MapScores out{};
  for (std::size_t m = 0; m < metric_count; ++m) out[m] = summaries[m].mean;
  return out;
}

}  // namespace echofuse::recon
