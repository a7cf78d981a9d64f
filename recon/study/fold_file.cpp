// SPDX-License-Identifier: MIT
#include "recon/study/fold_file.hpp"

#include <algorithm>

#include "drivers/core/console.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

template <class T>
std::string text_of(const std::optional<T>& value) {
  return value ? formatted("%.9g", static_cast<double>(*value)) : "-";
}

std::string text_of(const FitOptions& fit) {
  std::string hidden;
  if (fit.hidden)
    for (const std::size_t width : *fit.hidden) hidden += std::to_string(width) + ",";
  return formatted(
      "hidden %s basis %s epochs %s learning-rate %s weight-decay %s patience %s batch %s seed "
      "%llu",
      fit.hidden ? hidden.c_str() : "-", text_of(fit.basis).c_str(), text_of(fit.epochs).c_str(),
      text_of(fit.learning_rate).c_str(), text_of(fit.weight_decay).c_str(),
      text_of(fit.patience).c_str(), text_of(fit.batch).c_str(),
      static_cast<unsigned long long>(fit.seed));
}

}  // namespace

StudySettings fold_settings(const Dataset& data, const std::string& scaling, const FitOptions& fit,
                            const StudySettings& more) {
  StudySettings out = {{"study", "folds"},
                       {"echofuse", version()},
                       {"records", formatted("%zu (checksum %08x)", data.size(), data.hash)},
                       {"scaling", scaling},
                       {"fit", text_of(fit)}};
  out.insert(out.end(), more.begin(), more.end());
  return out;
}

FoldFile::FoldFile(const StudyOptions& options, const StudySettings& settings,
                   const std::string& inputs, const std::vector<std::string>& models,
                   std::size_t folds)
    : file_(options, settings, ExitCode::config),
      part_(options.part.has_value()),
      inputs_(inputs),
      models_(models) {
  std::vector<RowOfWork> rows;
  for (std::size_t fold = 0; fold < folds; ++fold)
    for (const auto& model : models) {
      const bool network = candidate_of(model, {}).fit.hidden.has_value();
      rows.push_back({std::to_string(rows.size()), network ? 5. : ignores_inputs(model) ? .1 : 1.});
    }
  mine_ = share_of(options.part, rows);
  if (!part_) read();
  shared_.mine = [this](std::size_t fold, std::size_t model) {
    return mine_[fold * models_.size() + model] && !(part_ && file_.has(row_of({fold, model}, 0)));
  };
  shared_.known = [this](std::size_t fold, std::size_t model) -> const FoldScores* {
    const auto found = known_.find({fold, model});
    return found == known_.end() ? nullptr : &found->second;
  };
  shared_.keep = [this](std::size_t fold, std::size_t model, const FoldScores& scores) {
    keep({fold, model}, scores);
  };
}

Measurement FoldFile::row_of(const Key& key, std::size_t map) const {
  return {"fold", std::to_string(key.first), models_[key.second], inputs_, map};
}

void FoldFile::read() {
  for (const Measurement& m : file_.all()) {
    const auto model = std::find(models_.begin(), models_.end(), m.model);
    const std::size_t fold = std::strtoul(m.value.c_str(), nullptr, 10);
    if (model == models_.end() || m.inputs != inputs_ || m.axis != "fold") continue;
    FoldScores& scores = known_[{fold, static_cast<std::size_t>(model - models_.begin())}];
    if (m.seed != scores.maps.size()) continue;  // else it is measured again
    MapScores& map = scores.maps.emplace_back();
    for (std::size_t i = 0; i < metric_count; ++i) map[i] = m.metric(metric_names[i]);
    if (m.seed > 0) continue;
    scores.cost.multiply_adds = static_cast<std::size_t>(std::max(0., m.metric("multiply_adds")));
    scores.cost.parameters = static_cast<std::size_t>(std::max(0., m.metric("parameters")));
  }
}

void FoldFile::keep(const Key& key, const FoldScores& scores) {
  std::vector<Measurement> rows;
  for (std::size_t map = 0; map < scores.maps.size(); ++map) {
    Measurement& m = rows.emplace_back(row_of(key, map));
    for (std::size_t i = 0; i < metric_count; ++i) m.metrics[metric_names[i]] = scores.maps[map][i];
  }
  rows.front().metrics["multiply_adds"] = static_cast<double>(scores.cost.multiply_adds);
  rows.front().metrics["parameters"] = static_cast<double>(scores.cost.parameters);
  file_.add(rows);
}

}  // namespace echofuse::recon
