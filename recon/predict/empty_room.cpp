// SPDX-License-Identifier: MIT
#include "recon/predict/empty_room.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>

#include "drivers/util/printable.hpp"
#include "recon/data/response_conversion.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t min_records = 5;
// People are assumed to be in the room if the variance of the counts divided by the Poisson
// variance exceeds `max_scatter` + `max_scatter_a_count` x mean count.
constexpr double max_scatter = 4, max_scatter_a_count = 0.002;

// Replaces the background of the histogram with that of the empty room. Returns the correction to
// add to the radar values of records from that room, as columns with one row. `empty` must be on
// the model's axes.
std::vector<Column> take(Estimator& model, const std::string& path, const Dataset& empty) {
  if (model.features.array_count() > 0 && empty.array().cols == 0)
    throw Error(ExitCode::failed, printable(path) +
                                      ": contains no radar antenna samples, which the model "
                                      "needs; use a run that contains them");
  const Layout layout = model.features.layout();
  const std::vector<float>& home = model.alignment.background();
  std::vector<float> background = mean_observation(empty, model.features), change = home;
  std::transform(home.begin(), home.end(), background.begin(), change.begin(), std::minus<float>());
  Dataset out;
  out.radar() = repeated_row(layout.parts(std::span(change)).power, 1);
  out.array() = repeated_row(layout.parts(std::span(change)).lags, 1);
  const auto radar = layout.parts(std::span(background));
  std::ranges::copy(layout.parts(std::span(home)).power, radar.power.begin());
  std::ranges::copy(layout.parts(std::span(home)).lags, radar.lags.begin());
  model.alignment.set_background(background);
  return out.columns;
}

// Returns the variance of the counts divided by their Poisson variance. Scales the expected counts
// of each record by its total, because the laser power may drift.
double scatter(const Matrix& counts, const std::vector<double>& mean) {
  const double usual = std::accumulate(mean.begin(), mean.end(), 0.0);
  double sum = 0, terms = 0;
  for (std::size_t row = 0; row < counts.rows; ++row) {
    const auto found = counts.row(row);
    const double scale = std::accumulate(found.begin(), found.end(), 0.0) / std::max(usual, 1.0);
    for (std::size_t c = 0; c < mean.size(); ++c) {
      const double expected = scale * mean[c];
      sum += std::pow(double{found[c]} - expected, 2) / std::max(expected, 1.0), ++terms;
    }
  }
  return sum / std::max(terms, 1.0);
}

}  // namespace

EmptyRoom empty_room_of(const Dataset& empty, const std::string& path) {
  const Inputs all = inputs_of(empty);
  Rows rows;
  std::map<std::string, std::size_t> reasons;
  for (std::size_t row = 0; row < empty.size(); ++row) {
    std::string why =
        has_inputs(empty, row, all) ? doubt_of(empty, row, all, false) : "missing sensor";
    if (why.empty() && !fault_of(empty, row, all).empty()) why = dead_record;
    why.empty() ? rows.push_back(row) : void(++reasons[why]);
  }
  const std::string left_out = left_out_text(reasons, empty.size());
  if (rows.size() < min_records)
    throw Error(ExitCode::failed, printable(path) + ": " + std::to_string(rows.size()) +
                                      " records have data of all sensors; expected at least 5" +
                                      (left_out.empty() ? "" : "; " + left_out));
  Matrix counts(0, empty.spd().axis.count);
  for (const std::size_t row : rows) counts.add_row(counts_of(empty, row));
  const std::vector<double> mean = column_means(counts, all_rows(rows.size()));
  if (scatter(counts, mean) > max_scatter + max_scatter_a_count * mean_of(mean))
    throw Error(ExitCode::failed,
                printable(path) +
                    ": the histograms vary by more than photon noise, so there "
                    "may be people in the room; expected a run of the empty room");
  return {part_of(empty, rows), left_out.empty() ? "" : printable(path) + ": " + left_out};
}

EmptyRoom load_empty_room(const Dataset& data, const std::string& path) {
  Dataset empty = load({path});
  ModelResponse(data).convert(empty);
  match_axes(empty, {data.spd().axis, data.radar().axis, data.array().axis}, inputs_of(data),
             "that of the training runs");
  return empty_room_of(empty, path);
}

std::string adapt_to_room(TrainedModel& model, const std::string& path, double range_offset_m) {
  const std::size_t before = model.estimators.size();
  Dataset empty = load_recorded({path});
  subtract_range_offset(empty, range_offset_m);
  Rows seen;
  for (std::size_t row = 0; row < empty.size(); ++row)
    if (empty.has(row, Sensor::depth)) seen.push_back(row);
  if (!seen.empty()) require_map(empty, model.first().scene.grid, "the model");
  std::string text =
      seen.empty()
          ? printable(path) +
                ": the run has no depth maps, so predicted maps show the walls of the training room"
          : "";
  const std::vector<float> walls =
      seen.empty() ? model.first().scene.background : column_quantile(empty.depth(), seen, 0.5);
  if (!model.first().alignment.known() || !model.first().model->show_background(walls))
    throw Error(ExitCode::failed, model.first().name +
                                      " models cannot be used in another room; expected a "
                                      "factorised or mean-shape model");
  const std::vector<float>& home = model.first().scene.background;
  if (!model.first().has_empty_room &&
      std::any_of(home.begin(), home.end(), [](float depth_m) { return depth_m > 0; }))
    text += std::string(text.empty() ? "" : "; ") +
            "the model was trained without --empty, so the walls of the training room may affect "
            "the maps";
  model.match(empty);
  // Removes fallback estimators that depend on the training room.
  std::erase_if(model.estimators, [&](Estimator& e) {
    return !e.alignment.known() || !e.model->show_background(walls);
  });
  if (model.estimators.size() < before)
    text += std::string(text.empty() ? "" : "; ") +
            "records without radar data get no map, because the " +
            "fallback model for them depends on the training room";
  const EmptyRoom room = empty_room_of(empty, path);
  if (!room.left_out.empty()) text += (text.empty() ? "" : "; ") + room.left_out;
  for (Estimator& e : model.estimators) {
    e.scene.background = walls;
    const std::vector<Column> change = take(e, path, room.records);
    if (&e == &model.first()) model.room_change = change;
  }
  return text;
}

void exchange_room(const std::vector<Column>& change, Dataset& data) {
  for (std::size_t k = 0; k < change.size(); ++k) {
    const Column& by = change[k];
    Column& column = data.columns[k];
    if (by.rows == 0 || by.cols != column.cols) continue;
    // Leaves rows with equal values in all bins unchanged, so that a dead sensor is still detected.
    for (std::size_t i = 0; i < column.rows; ++i)
      if (const auto row = column.row(i); !all_same(row))
        std::ranges::transform(row, by.row(0), row.begin(), std::plus<float>());
  }
}

}  // namespace echofuse::recon
