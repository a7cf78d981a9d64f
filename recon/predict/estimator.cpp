// SPDX-License-Identifier: MIT
#include "recon/predict/estimator.hpp"

#include <chrono>
#include <cmath>

#include "drivers/util/exit_code.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

double seconds_since(std::chrono::steady_clock::time_point started) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
}

void archive_features(Archive archive, Features& f, bool views) {
  std::string inputs = name_of(f.inputs);
  archive.text("inputs", inputs, inputs_names);
  f.inputs = inputs_of(inputs);
  archive.text("scaling", f.scaling, views ? std::vector<std::string>{raw_scaling} : scaling_names);
  recon::archive(archive, f.axes);
  archive.require(f.axes.array.count == 0 || (f.inputs == Inputs::fused && views), "axes/array",
                  "expected only in a fused model with aligned inputs");
  archive.values("features/centre", f.centre, f.count());
  archive.number("features/spd_gain", f.spd_gain, -1e18, 1e18);
  archive.number("features/radar_gain", f.radar_gain, -1e18, 1e18);
}

void archive_training(Archive archive, FitOptions& fit, TrainingLog& log) {
  constexpr std::int64_t max_count = 1 << 30;
  archive.values("loss_m", log.loss, Archive::any);
  archive.values("validation_loss_m", log.validation_loss, log.loss.size());
  archive.count("best_epoch", log.best_epoch, 0, max_count);
  // The fit options below are stored only for information, and are never read.
  if (archive.reading()) return;
  std::vector<std::int64_t> hidden;
  for (const std::size_t width : fit.hidden.value_or(std::vector<std::size_t>{}))
    hidden.push_back(static_cast<std::int64_t>(width));
  archive.values("hidden", hidden, Archive::any);
  for (const auto& [name, value] : {std::pair{"epochs", fit.epochs},
                                    {"batch", fit.batch},
                                    {"patience", fit.patience},
                                    {"basis", fit.basis}}) {
    std::size_t count = value.value_or(0);
    archive.count(name, count, 0, max_count);
  }
  double rate = fit.learning_rate.value_or(0), decay = fit.weight_decay.value_or(0);
  archive.number("learning_rate", rate, 0, 1e9), archive.number("weight_decay", decay, 0, 1e9);
}

}  // namespace

std::vector<float> mean_observation(const Dataset& data, const Features& sensors) {
  const Rows all = all_rows(data.size());
  const std::vector<double> means = column_means(observe(data, all, sensors), all);
  return {means.begin(), means.end()};
}

Matrix Estimator::views(const Dataset& data, const Rows& rows, bool needed) const {
  if (!alignment.known() || !(needed || wants_alignment(name))) return Matrix(rows.size(), 0);
  return align(observe(data, rows, features), alignment);
}

const Matrix& Estimator::inputs(const Dataset& data, const Rows& rows, const Matrix& views,
                                Matrix& scaled) const {
  if (wants_alignment(name)) return views;
  if (ignores_inputs(name)) return scaled = Matrix(rows.size(), 0);
  return scaled = features.apply(data, rows);
}

Matrix Estimator::maps(const Dataset& data, const Rows& rows, const Matrix& views,
                       SoftMaps* soft) const {
  Matrix scaled;
  return model->predict(inputs(data, rows, views, scaled), soft);
}

Matrix Estimator::maps(const Dataset& data, const Rows& rows) const {
  return maps(data, rows, views(data, rows, false));
}

Cost Estimator::cost() const {
  Cost out = model->cost();
  if (wants_alignment(name)) out.multiply_adds += alignment.cost();
  return out;
}

void Estimator::archive(Archive archive) {
  archive.text("model", name, model_names());
  const bool takes_views = wants_alignment(name);
  archive_features(archive, features, takes_views);
  const Layout layout = features.layout();
  archive.require(!takes_views || layout.shows_sides(), "inputs",
                  "expected fused, because this kind of model needs " + needs_of_sides);
  recon::archive(archive.in("scene"), scene);
  archive.count("knows_empty_room", has_empty_room, 0, 1);
  archive.number("train_s", train_s, 0, 1e12);
  archive_training(archive.in("training"), fit, log);
  const bool aligned = archive.part("aligned", alignment.known());
  archive.require(!takes_views || aligned, "aligned", "expected 1 for this kind of model");
  if (aligned) {
    archive.require(layout.spd.count > 0, "aligned",
                    "expected 0, because the model does not use the detector");
    alignment.archive(archive.in("alignment"), layout);
  }
  if (archive.reading()) model = kind_of(name).make();
  model->archive(archive.in("model"), {takes_views ? alignment.inputs() : features.count(),
                                       scene.grid.pixels(), scene.grid});
  if (archive.part("knows_domain", domain.known()))
    domain.archive(archive.in("domain"), features.inputs, features.layout());
  if (archive.part("calibrated", uncertainty.has_value())) {
    if (archive.reading()) uncertainty.emplace();
    uncertainty->archive(archive.in("uncertainty"), features, alignment);
  }
}

Preprocessing::Preprocessing(const Dataset& data, const Rows& train, Inputs inputs,
                             SceneModel of_rows, bool needed, const Dataset& empty)
    : scene(std::move(of_rows)), has_empty_room(empty.size() > 0) {
  const auto started = std::chrono::steady_clock::now();
  views.rows = data.size();
  if (!needed || inputs == Inputs::radar) return;
  const Features sensors = fit_features(data, train, inputs, raw_scaling);
  const Matrix observations = observe(data, all_rows(data.size()), sensors);
  alignment = Alignment(sensors.layout(), observations, train);
  if (has_empty_room) alignment.set_background(mean_observation(empty, sensors));
  views = align(observations, alignment);
  elapsed_s = seconds_since(started);
}

Estimator fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                    const std::string& name, Inputs inputs, const std::string& scaling,
                    const FitOptions& options) {
  const auto started = std::chrono::steady_clock::now();
  Estimator out;
  const Candidate candidate = candidate_of(name, options, split.train.size());
  const bool takes_views = wants_alignment(candidate.model);
  out.name = candidate.model;
  out.features = fit_features(data, ignores_inputs(out.name) ? Rows{} : split.train, inputs,
                              takes_views           ? raw_scaling
                              : scaling == "record" ? kind_of(out.name).scaling
                                                    : scaling);
  if (takes_views && !out.features.layout().shows_sides())
    throw Error(ExitCode::usage, "the mean-shape and factorised models need " + needs_of_sides);
  out.scene = preprocessing.scene;
  if (takes_views) out.alignment = preprocessing.alignment;
  out.has_empty_room = takes_views && preprocessing.has_empty_room;
  out.model = kind_of(candidate.model).make();
  Matrix scaled;
  const Matrix& taken = out.inputs(data, all_rows(data.size()), preprocessing.views, scaled);
  const auto samples = [&](const Rows& rows) {
    return Samples{
        taken,         data.depth(), rows, &preprocessing.scene, &preprocessing.alignment,
        &data.radar(), &data.array()};
  };
  out.log = out.model->fit(samples(split.train), samples(split.validation), candidate.fit);
  out.fit = candidate.fit;
  out.train_s = preprocessing.elapsed_s + seconds_since(started);
  return out;
}

}  // namespace echofuse::recon
