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

constexpr std::size_t least_records = 5;
// People are assumed to be in the room if the variance of the counts divided by the Poisson
// variance exceeds `most_scatter` + `most_scatter_a_count` x mean count.
constexpr double most_scatter = 4, most_scatter_a_count = 0.002;

std::vector<float> mean_of_rows(const Matrix& table, const Rows& rows) {
  const std::vector<double> means = column_means(table, rows);
  return {means.begin(), means.end()};
}

std::vector<float> less(const std::vector<float>& a, const std::vector<float>& b) {
  std::vector<float> out(a.size());
  std::transform(a.begin(), a.end(), b.begin(), out.begin(), std::minus<float>());
  return out;
}

// Replaces the background of the model with the counts of the empty room. Returns the correction to
// add to the radar values of records from that room. `empty` must be on the model's axes.
EmptyRoom take(Estimator& model, const std::string& path, const Dataset& empty) {
  EmptyRoom now = empty_room_of(empty, path);
  if (model.features.radar_count() == 0) now.radar.clear();
  if (model.features.array_count() == 0) now.array.clear();
  require_zones(empty, model.features.zones);
  if (model.features.zones.empty()) now.zone_spd.clear();
  if (model.features.array_count() > 0 && now.array.empty())
    throw Error(ExitCode::failed, printable(path) +
                                      ": contains no radar antenna samples, which the model "
                                      "needs; use a run that contains them");
  const std::vector<float> then = model.alignment.background();
  const auto radar_at = std::ssize(now.spd), array_at = radar_at + std::ssize(now.radar),
             zones_at = std::ssize(then) - std::ssize(now.zone_spd);
  const EmptyRoom before{{then.begin(), then.begin() + radar_at},
                         {then.begin() + radar_at, then.begin() + array_at},
                         {then.begin() + array_at, then.begin() + zones_at}};
  EmptyRoom change{{}, less(before.radar, now.radar), {}, {}, now.left_out};
  if (before.array.size() == now.array.size()) change.array = less(before.array, now.array);
  std::vector<float> background = then;
  std::copy(now.spd.begin(), now.spd.end(), background.begin());
  std::copy(now.zone_spd.begin(), now.zone_spd.end(), background.begin() + zones_at);
  model.alignment.set_background(background);
  return change;
}

// Returns the variance of the counts divided by their Poisson variance. Scales the expected counts
// of each record by its total, because the laser power may drift.
double scatter(const Matrix& counts, const Rows& rows, const std::vector<float>& mean) {
  const double usual = std::accumulate(mean.begin(), mean.end(), 0.0);
  double sum = 0, terms = 0;
  for (const std::size_t row : rows) {
    const auto found = counts.row(row);
    const double scale = std::accumulate(found.begin(), found.end(), 0.0) / std::max(usual, 1.0);
    for (std::size_t c = 0; c < mean.size(); ++c) {
      const double expected = scale * double{mean[c]};
      sum += std::pow(double{found[c]} - expected, 2) / std::max(expected, 1.0), ++terms;
    }
  }
  return sum / std::max(terms, 1.0);
}

}  // namespace

EmptyRoom empty_room_of(const Dataset& empty, const std::string& path) {
  const Inputs all = empty.radar_axis.count == 0   ? Inputs::spd
                     : empty.spd_axis.count == 0   ? Inputs::radar
                     : empty.array_axis.count == 0 ? Inputs::fused_profile
                                                   : Inputs::fused;
  Rows rows;
  std::map<std::string, std::size_t> reasons;
  for (std::size_t row = 0; row < empty.size(); ++row) {
    std::string why =
        empty.has_inputs(row, all) ? empty.doubt_of(row, all, false) : "missing sensor";
    if (why.empty() && !empty.fault_of(row, all).empty()) why = dead_record;
    why.empty() ? rows.push_back(row) : void(++reasons[why]);
  }
  const std::string left_out = left_out_text(reasons, empty.size());
  if (rows.size() < least_records)
    throw Error(ExitCode::failed, printable(path) + ": " + std::to_string(rows.size()) +
                                      " records have data of all sensors; expected at least 5" +
                                      (left_out.empty() ? "" : "; " + left_out));
  EmptyRoom out{mean_of_rows(empty.spd, rows), mean_of_rows(empty.radar, rows),
                mean_of_rows(empty.array, rows), mean_of_rows(empty.zone_spd, rows),
                left_out.empty() ? "" : printable(path) + ": " + left_out};
  const double counts = out.spd.empty() ? 0
                                        : std::accumulate(out.spd.begin(), out.spd.end(), 0.0) /
                                              static_cast<double>(out.spd.size());
  if (scatter(empty.spd, rows, out.spd) > most_scatter + most_scatter_a_count * counts)
    throw Error(ExitCode::failed,
                printable(path) +
                    ": the histograms vary by more than photon noise, so there "
                    "may be people in the room; expected a run of the empty room");
  return out;
}

std::string state_empty_room(Dataset& data, const std::string& path) {
  Dataset empty = load({path});
  bring_to_response(empty, widest_response(data));
  const Inputs sensors = data.radar_axis.count == 0 ? Inputs::spd
                         : data.spd_axis.count == 0 ? Inputs::radar
                                                    : Inputs::fused;
  match_axes(empty, data.spd_axis, data.radar_axis, sensors, "that of the training runs");
  match_array(empty, data.array_axis);
  require_zones(empty, data.zones);
  data.empty_room = empty_room_of(empty, path);
  return data.empty_room.left_out;
}

std::string adapt_to_room(TrainedModel& model, const std::string& path, double range_offset_m) {
  const std::size_t before = model.estimators.size();
  Dataset empty = load_recorded({path});
  subtract_range_offset(empty, range_offset_m);
  Rows seen;
  for (std::size_t row = 0; row < empty.size(); ++row)
    if (empty.has(row, Sensor::depth)) seen.push_back(row);
  if (!seen.empty()) require_map(empty, model->scene.grid, "the model");
  std::string text =
      seen.empty()
          ? printable(path) +
                ": the run has no depth maps, so predicted maps show the walls of the training room"
          : "";
  const std::vector<float> walls =
      seen.empty() ? model->scene.background : column_quantile(empty.depth, seen, 0.5);
  if (!model->alignment.known() || !model->model->show_background(walls))
    throw Error(ExitCode::failed, model->name +
                                      " models cannot be used in another room; expected a "
                                      "factorised or mean-shape model");
  const std::vector<float>& home = model->scene.background;
  if (!model->knows_empty_room &&
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
  for (Estimator& e : model.estimators) {
    e.scene.background = walls;
    EmptyRoom change = take(e, path, empty);
    if (&e != &model.first()) continue;
    if (!change.left_out.empty()) text += (text.empty() ? "" : "; ") + change.left_out;
    model.room_change = std::move(change);
  }
  return text;
}

void exchange_room(const EmptyRoom& change, Dataset& data) {
  const auto add = [](std::span<float> row, const std::vector<float>& by) {
    std::transform(by.begin(), by.end(), row.begin(), row.begin(), std::plus<float>());
  };
  // Leaves rows with equal values in all bins unchanged, so that a dead sensor is still detected.
  for (std::size_t row = 0; row < data.size(); ++row) {
    if (data.radar.cols == change.radar.size() && !all_same(data.radar.row(row)))
      add(data.radar.row(row), change.radar);
    if (data.array.cols == change.array.size() && !data.lacks_array(row))
      add(data.array.row(row), change.array);
  }
}

}  // namespace echofuse::recon
