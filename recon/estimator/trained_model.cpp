// SPDX-License-Identifier: MIT
#include "recon/estimator/trained_model.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>

#include "acquire/record/depth_map.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t chunk_rows = 512;  // bounds the memory that a prediction needs

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

void require_finite(const Matrix& maps) {
  if (std::all_of(maps.values.begin(), maps.values.end(), [](float v) { return std::isfinite(v); }))
    return;
  throw Error(
      ExitCode::failed,
      "the model's maps are not finite numbers: its weights are none that a training makes; "
      "train it again");
}

SeenRecords remember(const Dataset& data, const Split& split) {
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

void TrainedModel::match(Dataset& data) const {
  const bool lost = fallback && data.radar_axis.count == 0;
  match_axes(data, features.spd_axis, features.radar_axis, lost ? Inputs::spd : features.inputs);
  if (!lost) return;
  data.radar_axis = features.radar_axis;
  data.radar = Matrix(data.size(), data.radar_axis.count);
}

bool TrainedModel::falls_back(const Dataset& data, std::size_t row) const {
  return fallback && !data.fault_of(row, features.inputs).empty() &&
         data.fault_of(row, fallback->features.inputs).empty();
}

std::string TrainedModel::fault_of(const Dataset& data, std::size_t row) const {
  return falls_back(data, row) ? "" : data.fault_of(row, features.inputs);
}

std::vector<TrainedModel::Share> TrainedModel::shares(const Dataset& data, const Rows& rows) const {
  Share own{*this, {}, {}}, others{fallback ? *fallback : *this, {}, {}};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Share& share = falls_back(data, rows[i]) ? others : own;
    share.places.push_back(i);
    share.rows.push_back(rows[i]);
  }
  if (others.rows.empty()) return {own};
  return {own, others};
}

Matrix TrainedModel::predict(const Dataset& data, const Rows& rows) const {
  Matrix out(rows.size(), data.depth.cols);
  for (const auto& [by, places, own_rows] : shares(data, rows))
    for (std::size_t first = 0; first < places.size(); first += chunk_rows) {
      const std::size_t count = std::min(chunk_rows, places.size() - first);
      const auto begin = own_rows.begin() + static_cast<std::ptrdiff_t>(first);
      const Matrix maps = by.model->predict(
          by.features.apply(data, {begin, begin + static_cast<std::ptrdiff_t>(count)}));
      require_finite(maps);
      for (std::size_t i = 0; i < count; ++i)
        std::copy_n(maps.row(i).begin(), maps.cols, out.row(places[first + i]).begin());
    }
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

TrainedModel fit_model(const Dataset& data, const Split& split, const std::string& name,
                       Inputs inputs, const std::string& scaling, const FitOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  TrainedModel out;
  const Rung rung = rung_of(name, options);
  out.name = rung.model;
  out.features =
      fit_features(data, split.train, inputs, wants_readings(rung.model) ? raw_scaling : scaling);
  out.scene = learn_scene(data.depth, split.train);
  out.model = make_model(rung.model);
  const Matrix scaled = out.features.apply(data, all_rows(data.size()));
  const Layout layout = out.features.layout();
  out.log = out.model->fit({scaled, data.depth, split.train, layout},
                           {scaled, data.depth, split.validation, layout}, rung.fit);
  out.fit = rung.fit;
  out.data_hash = data.hash;
  out.train_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
  return out;
}

}  // namespace echofuse::recon
