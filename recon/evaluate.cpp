// SPDX-License-Identifier: MIT
#include "recon/evaluate.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>

#include "drivers/core/exit_code.hpp"

namespace echofuse::recon {
namespace {

// The given map as the answer to every record.
Matrix constant_maps(const std::vector<float>& map, std::size_t rows) {
  Matrix out(0, map.size());
  for (std::size_t i = 0; i < rows; ++i) out.add_row(map);
  return out;
}

Matrix nearest_maps(const TrainedModel& trained, const Dataset& data, const Rows& rows,
                    const Dataset& neighbours_data, const Rows& neighbours) {
  const Matrix inputs = trained.features.apply(neighbours_data, neighbours);
  const Matrix maps = take_rows(neighbours_data.depth, neighbours);
  const auto model = make_nearest();
  model->fit({inputs, maps, all_rows(neighbours.size())}, {inputs, maps, {}}, {});
  return model->predict(trained.features.apply(data, rows));
}

}  // namespace

Rows rows_to_evaluate(const TrainedModel& model, const Dataset& data, bool all) {
  const bool held_out = !all && model.knows(data);
  Rows rows = held_out ? model.rows_of(data, Part::test)
                       : data.usable(model.fallback ? model.fallback->features.inputs
                                                    : model.features.inputs);
  if (!rows.empty()) return rows;
  const std::string path = data.sources.empty() ? "run" : data.sources.front().path;
  throw Error(ExitCode::failed,
              held_out ? path +
                             ": the model was trained on this run and held none of its records "
                             "out; use --all to score it on what it has seen"
                       : path + ": no record has depth and the sensors of a \"" +
                             name_of(model.features.inputs) + "\" model");
}

std::string match_model(Dataset& data, const TrainedModel& model, SlipAction action) {
  const Matrix recorded = data.radar;
  const Axis recorded_axis = data.radar_axis;
  model.match(data);
  if (action == SlipAction::ignore || !model.slip.known()) return {};
  std::vector<float> found;
  model.slip.measure(data, found);
  const Slip slip = model.slip.judge(found);
  const bool correct = action == SlipAction::correct;
  if (correct && slip.verdict == Slip::Verdict::found) {
    data.radar = recorded, data.radar_axis = recorded_axis;
    shorten_radar(data, slip.metres);
    model.match(data);
  }
  return slip.text(correct);
}

std::vector<MapScores> score_maps(const Matrix& maps, const Dataset& data, const Rows& rows,
                                  const Scene& scene) {
  std::vector<MapScores> out;
  for (std::size_t i = 0; i < rows.size(); ++i)
    out.push_back(score(maps.row(i), data.depth.row(rows[i]), scene));
  return out;
}

Evaluation evaluate(const TrainedModel& model, const Dataset& data, const Rows& rows,
                    const Dataset& neighbours_data, const Rows& neighbours,
                    const std::string& output) {
  const auto scored = [&](const Matrix& maps) {
    return summarise(score_maps(maps, data, rows, model.scene));
  };
  Evaluation out;
  out.model = model.name;
  out.inputs = model.features.inputs;
  out.records = rows.size();
  for (const std::size_t row : rows) out.fallback_records += model.falls_back(data, row);
  out.metrics = scored(answer(model, data, rows, output, false).maps);
  if (model.confidence) out.calibration = calibration_of(model, data, rows);
  out.trivial.push_back({"empty", scored(constant_maps(model.scene.background, rows.size()))});
  out.trivial.push_back({"mean", scored(constant_maps(model.scene.mean_map, rows.size()))});
  if (!neighbours.empty())
    out.trivial.push_back(
        {"nearest", scored(nearest_maps(model, data, rows, neighbours_data, neighbours))});
  return out;
}

Calibration calibration_of(const TrainedModel& model, const Dataset& data, const Rows& rows) {
  constexpr std::size_t at_once = 512;
  double within = 0, stated = 0, known = 0, flagged = 0, squares = 0, variance = 0;
  for (std::size_t first = 0; first < rows.size(); first += at_once) {
    const Rows part(
        rows.begin() + static_cast<std::ptrdiff_t>(first),
        rows.begin() + static_cast<std::ptrdiff_t>(std::min(first + at_once, rows.size())));
    const Matrix maps = model.predict(data, part);
    const auto claimed = claims(model, data, part, maps);
    const PixelMaps pixels = pixel_maps(model, data, part, maps, claimed);
    for (std::size_t i = 0; i < part.size(); ++i) {
      const auto truth = data.depth.row(part[i]);
      flagged += !claimed[i].strangeness.why.empty();
      for (std::size_t p = 0; p < truth.size(); ++p) {
        squares += std::pow(double{pixels.mean.row(i)[p]} - double{truth[p]}, 2);
        variance += std::pow(double{pixels.deviation.row(i)[p]}, 2);
      }
      const double error = lateral_error(maps.row(i), truth, model.scene);
      if (std::isnan(error) || std::isnan(claimed[i].lateral_90_m)) continue;
      within += error <= claimed[i].lateral_90_m, stated += claimed[i].lateral_90_m, ++known;
    }
  }
  const auto all = static_cast<double>(rows.size());
  const double pixels = all * static_cast<double>(data.depth.cols);
  return {within / known, stated / known, flagged / all, std::sqrt(squares / pixels),
          std::sqrt(variance / pixels)};
}

RunningCost measure_cost(const TrainedModel& model, const Dataset& data, const Rows& rows,
                         const std::string& model_path) {
  using Clock = std::chrono::steady_clock;
  constexpr std::size_t warm_up = 20, repeats = 400;
  std::vector<double> us;
  for (std::size_t i = 0; i < warm_up + repeats; ++i) {
    const Rows one{rows[i % rows.size()]};
    const auto started = Clock::now();
    model.model->predict(model.features.apply(data, one));
    const std::chrono::duration<double, std::micro> taken = Clock::now() - started;
    if (i >= warm_up) us.push_back(taken.count());
  }
  std::sort(us.begin(), us.end());
  return {model.model->cost(), us[repeats / 2], us[repeats * 99 / 100], model.train_s,
          static_cast<std::size_t>(std::filesystem::file_size(model_path))};
}

}  // namespace echofuse::recon
