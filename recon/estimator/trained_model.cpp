// SPDX-License-Identifier: MIT
#include "recon/estimator/trained_model.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>

namespace echofuse::recon {
namespace {

// Run number in seen.runs of each source of the data set, or -1.
std::vector<std::int64_t> known_runs(const SeenRecords& seen, const Dataset& data) {
  std::vector<std::int64_t> out;
  for (const auto& source : data.sources) {
    const auto found = std::find(seen.runs.begin(), seen.runs.end(), source.uuid);
    out.push_back(found == seen.runs.end() ? -1 : found - seen.runs.begin());
  }
  return out;
}

}  // namespace

SeenRecords seen_records(const Dataset& data, const Split& split) {
  SeenRecords seen;
  for (const auto& source : data.sources) seen.runs.push_back(source.uuid);
  const auto add = [&](const Rows& rows, Part part) {
    for (const std::size_t row : rows) {
      seen.run.push_back(static_cast<std::uint32_t>(data.source_of(row)));
      seen.index.push_back(data.index[row]);
      seen.part.push_back(static_cast<std::uint8_t>(part));
    }
  };
  add(split.train, Part::train);
  add(split.validation, Part::validation);
  add(split.test, Part::test);
  return seen;
}

const TrainedModel& TrainedModel::for_run(const Dataset& data) const {
  const bool lost = data.radar_axis.count == 0;  // then the SPD answers
  const bool fits =
      lost || features.array_axis.count == 0 || covers(data.array_axis, features.array_axis);
  return !fits && fallback && both_sensors(fallback->features.inputs) ? *fallback : *this;
}

void TrainedModel::match(Dataset& data) const {
  if (const TrainedModel& other = for_run(data); &other != this) return other.match(data);
  require_map(data, scene.grid, "the model");
  const bool lost = fallback && data.radar_axis.count == 0;
  match_axes(data, features.spd_axis, features.radar_axis, lost ? Inputs::spd : features.inputs);
  if (!lost) return match_array(data, features.array_axis);
  data.array_axis = features.array_axis;
  data.array = Matrix(data.size(), features.array_count());
  data.radar_axis = features.radar_axis;
  data.radar = Matrix(data.size(), data.radar_axis.count);
}

bool TrainedModel::falls_back(const Dataset& data, std::size_t row) const {
  return fallback && !data.fault_of(row, features.inputs).empty() &&
         fallback->fault_of(data, row).empty();
}

const TrainedModel& TrainedModel::answering(const Dataset& data, std::size_t row) const {
  const TrainedModel* by = &for_run(data);
  while (by->falls_back(data, row)) by = by->fallback.get();
  return *by;
}

std::string TrainedModel::note_of(const Dataset& data, std::size_t row) const {
  const TrainedModel& by = answering(data, row);
  if (&by == &for_run(data)) return {};
  return by.features.inputs == Inputs::spd ? "radar lost: SPD alone"
                                           : "antennas lost: range profile alone";
}

std::string TrainedModel::fault_of(const Dataset& data, std::size_t row) const {
  return falls_back(data, row) ? "" : data.fault_of(row, features.inputs);
}

std::vector<TrainedModel::Assignment> TrainedModel::assign_rows(const Dataset& data,
                                                                const Rows& rows) const {
  std::vector<Assignment> out;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const TrainedModel& by = answering(data, rows[i]);
    std::size_t part = 0;
    while (part < out.size() && &out[part].by != &by) ++part;
    if (part == out.size()) out.push_back({by, {}, {}});
    out[part].places.push_back(i);
    out[part].rows.push_back(rows[i]);
  }
  return out;
}

Matrix TrainedModel::align(const Dataset& data, const Rows& rows, bool wanted) const {
  if (!alignment.known() || !(wanted || wants_alignment(name))) return Matrix(rows.size(), 0);
  return alignment(features.raw_inputs(data, rows));
}

Matrix TrainedModel::inputs(const Dataset& data, const Rows& rows, const Matrix& aligned) const {
  return wants_alignment(name) ? context.before(alignment.with_correlations(aligned))
                               : features.apply(data, rows);
}

Cost TrainedModel::cost() const {
  Cost out = model->cost();
  if (wants_alignment(name)) out.multiply_adds += alignment.cost();
  return out;
}

bool TrainedModel::knows(const Dataset& data) const {
  const auto runs = known_runs(seen, data);
  return std::any_of(runs.begin(), runs.end(), [](std::int64_t run) { return run >= 0; });
}

Rows TrainedModel::rows_of(const Dataset& data, Part part) const {
  const auto runs = known_runs(seen, data);
  std::map<std::pair<std::int64_t, std::int64_t>, std::size_t> row_of;
  for (std::size_t s = 0; s < runs.size(); ++s)
    for (std::size_t i = 0; i < data.sources[s].count; ++i) {
      const std::size_t row = data.sources[s].first + i;
      row_of[{runs[s], data.index[row]}] = row;
    }
  Rows rows;
  for (std::size_t i = 0; i < seen.index.size(); ++i) {
    if (seen.part[i] != static_cast<std::uint8_t>(part)) continue;
    const auto found = row_of.find({seen.run[i], seen.index[i]});
    if (found != row_of.end()) rows.push_back(found->second);
  }
  return rows;
}

Preprocessing::Preprocessing(const Dataset& data, const Rows& train, Inputs inputs, Scene of_rows,
                             bool wanted, Gains gains)
    : scene(std::move(of_rows)) {
  const auto started = std::chrono::steady_clock::now();
  aligned.rows = data.size();
  if (!wanted || inputs == Inputs::radar) return;
  const Features raw = fit_features(data, train, inputs, raw_scaling);
  const Matrix raw_inputs = raw.raw_inputs(data, all_rows(data.size()));
  alignment = Alignment(raw.layout(), raw_inputs, train, gains);
  if (data.empty_room.known()) {
    const EmptyRoom& room = data.empty_room;
    std::vector<float> still = room.spd;
    if (raw.radar_count() > 0) still.insert(still.end(), room.radar.begin(), room.radar.end());
    if (raw.array_count() > 0) still.insert(still.end(), room.array.begin(), room.array.end());
    alignment.set_background(still);
  }
  aligned = alignment(raw_inputs);
  if (both_sensors(inputs))
    context = RunContext(alignment, data, aligned, laboratories_of(data, train), inputs,
                         train.size(), contexts);
  elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
}

TrainedModel fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                       const std::string& name, Inputs inputs, const std::string& scaling,
                       const FitOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  TrainedModel out;
  const Candidate candidate = candidate_of(name, options, split.train.size());
  const bool aligned = wants_alignment(candidate.model);
  out.name = candidate.model;
  out.features = fit_features(data, split.train, inputs, aligned ? raw_scaling : scaling);
  if (aligned && (out.features.spd_count() == 0 || out.features.radar_count() == 0))
    throw Error(ExitCode::usage,
                "the silhouette and factorised models need both sensors: --inputs fused");
  out.scene = preprocessing.scene;
  if (aligned) out.alignment = preprocessing.alignment, out.context = preprocessing.context;
  out.knows_empty_room = aligned && data.empty_room.known();
  out.model = kind_of(candidate.model).make();
  const Matrix taken =
      out.context.size() > 0
          ? RunContext::before(out.alignment.with_correlations(preprocessing.aligned),
                               preprocessing.contexts)
          : out.inputs(data, all_rows(data.size()), preprocessing.aligned);
  const auto samples = [&](const Rows& rows) {
    return Samples{taken,       data.depth, rows, &preprocessing.scene, &preprocessing.alignment,
                   &data.radar, &data.array};
  };
  out.log = out.model->fit(samples(split.train), samples(split.validation), candidate.fit);
  out.fit = candidate.fit;
  out.data_hash = data.hash;
  out.train_s = preprocessing.elapsed_s +
                std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace echofuse::recon
