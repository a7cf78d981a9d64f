// SPDX-License-Identifier: MIT
#include "recon/predict/trained_model.hpp"

#include <algorithm>
#include <map>
#include <set>

#include "recon/data/copies.hpp"

namespace echofuse::recon {
namespace {

// Returns, for each run in the data set, its index in training.runs; -1 if the run was not used in
// training.
std::vector<std::int64_t> known_runs(const TrainingRecords& training, const Dataset& data) {
  std::vector<std::int64_t> out;
  for (const auto& source : data.sources) {
    const auto found = std::find(training.runs.begin(), training.runs.end(), source.uuid);
    out.push_back(found == training.runs.end() ? -1 : found - training.runs.begin());
  }
  return out;
}

}  // namespace

TrainingRecords training_records(const Dataset& data, const Split& split) {
  TrainingRecords training;
  for (const auto& source : data.sources) training.runs.push_back(source.uuid);
  const auto add = [&](const Rows& rows, Subset part) {
    for (const std::size_t row : rows) {
      training.run.push_back(static_cast<std::uint32_t>(data.source_of(row)));
      training.index.push_back(data.records[row].index);
      training.part.push_back(static_cast<std::uint8_t>(part));
      training.hash.push_back(data.records[row].content);
    }
  };
  add(split.train, Subset::train);
  add(split.validation, Subset::validation);
  add(split.test, Subset::test);
  return training;
}

double TrainedModel::train_s() const {
  double out = 0;
  for (const Estimator& e : estimators) out += e.train_s;
  return out;
}

namespace {

bool has_radar(const Dataset& data) { return data.radar().axis.count > 0; }

// Returns true if the run has no radar, the estimator does not use antennas, or the run contains
// the antennas used by the estimator.
bool has_antennas(const Dataset& data, const Estimator& e) {
  return !has_radar(data) || e.features.axes.array.count == 0 ||
         is_near(data.array().axis, e.features.axes.array);
}

}  // namespace

const Estimator& TrainedModel::for_run(const Dataset& data) const {
  for (const Estimator& e : estimators)
    if (has_antennas(data, e) && (&e == &first() || both_sensors(e.features.inputs))) return e;
  return first();
}

void TrainedModel::match(Dataset& data) const {
  const Features& features = for_run(data).features;
  require_map(data, first().scene.grid, "the model");
  data.exclusions = exclusions;
  const bool lost = !has_radar(data) && estimators.back().features.inputs == Inputs::spd;
  match_axes(data, features.axes, lost ? Inputs::spd : features.inputs);
  response.convert(data);
  if (!lost || features.inputs == Inputs::spd) return;
  for (const auto& [column, axis] :
       {std::pair{&data.radar(), &features.axes.radar}, {&data.array(), &features.axes.array}})
    *column = Matrix(data.size(), axis->size()), column->axis = *axis;
}

const Estimator* TrainedModel::estimator_for(const Dataset& data, std::size_t row) const {
  for (const Estimator* e = &for_run(data); e <= &estimators.back(); ++e)
    if (recon::fault_of(data, row, e->features.inputs).empty()) return e;
  return nullptr;
}

std::string TrainedModel::note_of(const Dataset& data, std::size_t row) const {
  const Estimator* by = estimator_for(data, row);
  if (!by || by == &for_run(data)) return {};
  return by->features.inputs == Inputs::spd ? "radar lost: SPD alone"
                                            : "antennas lost: range profile alone";
}

std::string TrainedModel::fault_of(const Dataset& data, std::size_t row) const {
  return estimator_for(data, row) ? "" : recon::fault_of(data, row, for_run(data).features.inputs);
}

bool TrainedModel::was_trained_on(const Dataset& data) const {
  const auto runs = known_runs(training, data);
  return std::any_of(runs.begin(), runs.end(), [](std::int64_t run) { return run >= 0; });
}

Rows TrainedModel::rows_trained_on(const Dataset& data) const {
  Copies known;
  for (std::size_t i = 0; i < training.hash.size(); ++i)
    if (training.part[i] != static_cast<std::uint8_t>(Subset::test))
      known.first(training.hash[i], i);
  std::set<std::size_t> rows;
  for (std::size_t row = 0; row < data.size(); ++row)
    if (known.contains(data.records[row].content)) rows.insert(row);
  for (const Subset part : {Subset::train, Subset::validation})
    for (const std::size_t row : rows_of(data, part)) rows.insert(row);
  return {rows.begin(), rows.end()};
}

Rows TrainedModel::rows_of(const Dataset& data, Subset part) const {
  const auto runs = known_runs(training, data);
  std::map<std::pair<std::int64_t, std::int64_t>, std::size_t> row_of;
  for (std::size_t s = 0; s < runs.size(); ++s)
    for (std::size_t i = 0; i < data.sources[s].count; ++i) {
      const std::size_t row = data.sources[s].first + i;
      row_of[{runs[s], data.records[row].index}] = row;
    }
  Rows rows;
  for (std::size_t i = 0; i < training.index.size(); ++i) {
    if (training.part[i] != static_cast<std::uint8_t>(part)) continue;
    const auto found = row_of.find({training.run[i], training.index[i]});
    if (found != row_of.end()) rows.push_back(found->second);
  }
  return rows;
}

}  // namespace echofuse::recon
