// SPDX-License-Identifier: MIT
#include "recon/study/study.hpp"

#include <algorithm>
#include <map>

#include "drivers/core/exit_code.hpp"
#include "recon/estimator/train.hpp"

namespace echofuse::recon {

StudyModel::StudyModel(const std::string& text)
    : name(text), candidate(text.substr(0, text.find(':'))) {
  if (candidate.size() < text.size()) inputs = text.substr(candidate.size() + 1);
  const Inputs wanted = inputs_of(inputs);
  if (wants_alignment(candidate_of(candidate, {}).model) && !both_sensors(wanted))
    throw Error(ExitCode::usage, "model \"" + text + "\": needs both sensors");
}

std::vector<bool> share_of(const std::optional<JobPart>& part, const std::vector<RowOfWork>& rows) {
  if (!part) return std::vector<bool>(rows.size(), true);
  std::map<std::string, std::size_t> numbers;  // of the pieces, in the order of their first rows
  std::vector<double> work;
  for (const RowOfWork& row : rows) {
    const auto [piece, added] = numbers.emplace(row.piece, work.size());
    if (added) work.push_back(0);
    work[piece->second] += row.work;
  }
  const std::vector<bool> mine = part->share(work);
  std::vector<bool> out;
  for (const RowOfWork& row : rows) out.push_back(mine[numbers.at(row.piece)]);
  return out;
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
                          const OptionalParts& parts) {
  TrainOptions how;
  how.model = model.candidate;
  how.inputs = model.inputs;
  how.split.test_share = 0;
  how.split.seed = how.fit.seed = seed;
  how.fit.quiet = true;
  how.fallback = parts.fallback;
  // It takes long to learn.
  how.uncertainty = parts.two_bodies && wants_alignment(candidate_of(model.candidate, {}).model);
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
