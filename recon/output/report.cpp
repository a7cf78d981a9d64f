// SPDX-License-Identifier: MIT
#include "recon/output/report.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>

#include "drivers/core/exit_code.hpp"
#include "recon/estimator/predict.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"
#include "recon/output/figure.hpp"

namespace echofuse::recon {
namespace {

struct LoadedMode {
  ModeResult result;
  std::vector<TrainedModel> models;
};

// Mean over the models; with several, the spread over them is the honest error.
Summaries over_models(const std::vector<Evaluation>& evaluations) {
  if (evaluations.size() == 1) return evaluations.front().metrics;
  std::vector<MapScores> means;
  for (const auto& e : evaluations) {
    MapScores row;
    for (std::size_t m = 0; m < metric_count; ++m) row[m] = e.metrics[m].mean;
    means.push_back(row);
  }
  return summarise(means);
}

// Those with both sensors alive, on which all three modes can be compared.
Rows rows_of_both(const TrainedModel& model, const Dataset& data) {
  Rows rows = rows_to_evaluate(model, data, false);
  std::erase_if(rows, [&](auto row) { return !data.fault_of(row, Inputs::fused).empty(); });
  if (rows.empty())
    throw Error(ExitCode::failed, data.sources.front().path +
                                      ": no record with depth has both sensors, which the three "
                                      "modes are compared on");
  return rows;
}

// Each model brings a copy of the data onto its own axes.
LoadedMode score_mode(const std::string& name, Inputs inputs, double paper_ssim,
                      const std::vector<std::string>& paths, const Dataset& data) {
  LoadedMode mode{{name, inputs, paper_ssim, {}, {}}, {}};
  for (const auto& path : paths) {
    TrainedModel model = load_model(path);
    const Features& f = model.features;
    if (f.inputs != inputs && !(both_sensors(f.inputs) && both_sensors(inputs)))
      throw Error(ExitCode::failed,
                  path + ": was trained on " + name_of(f.inputs) + " inputs, given as --" + name);
    const Records records = prepare_records(model, data, RangeBiasAction::warn);
    const Rows rows = rows_of_both(model, records.data);
    Evaluation e = evaluate(model, records, rows);
    e.left_out += rows_to_evaluate(model, records.data, false).size() - rows.size();
    e.cost = measure_cost(model, records.data, rows, path);
    mode.result.evaluations.push_back(std::move(e));
    mode.models.push_back(std::move(model));
  }
  mode.result.metrics = over_models(mode.result.evaluations);
  return mode;
}

// Of the candidates, the row whose fused reconstruction is of median quality: no picked cherries.
std::size_t median_row(const TrainedModel& fused, const Dataset& data, const Rows& candidates) {
  std::vector<std::pair<double, std::size_t>> order;
  const Records records =
      prepare_records(fused, part_of(data, candidates), RangeBiasAction::ignore);
  const Rows all = all_rows(candidates.size());
  const auto scores = score_maps(predict(fused, records, all, PredictionDetail::maps).maps,
                                 records.data, all, fused.scene);
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const double iou = scores[i][metric_iou];
    order.emplace_back(std::isnan(iou) ? 0 : iou, candidates[i]);
  }
  std::sort(order.begin(), order.end());
  return order[order.size() / 2].second;
}

Curve spd_curve(const Dataset& data, std::size_t row) {
  Curve out{"SPD counts", Ink::blue, {}, {}};
  const auto counts = data.spd.row(row);
  out.value.assign(counts.begin(), counts.end());
  for (std::size_t i = 0; i < counts.size(); ++i)
    out.range_m.push_back(data.spd_axis.at(static_cast<double>(i) + 0.5) / ps_per_m);
  return out;
}

Curve radar_curve(const Dataset& data, std::size_t row) {
  Curve out{"radar power", Ink::orange, {}, {}};
  const auto power = data.radar.row(row);
  out.value.assign(power.begin(), power.end());
  for (std::size_t i = 0; i < power.size(); ++i)
    out.range_m.push_back(data.radar_axis.at(static_cast<double>(i)));
  return out;
}

const char* mode_title(Inputs inputs) {
  if (both_sensors(inputs)) return "fused";
  return inputs == Inputs::spd ? "SPD only" : "radar only";
}

void show_uncertainty(FigureRow& row, const PredictionUncertainty& uncertainty) {
  row.uncertainty =
      std::isnan(uncertainty.lateral_interval_90_m)
          ? "place unknown"
          : formatted("within %.0f cm sideways (90 %%)", 100 * uncertainty.lateral_interval_90_m);
  if (!uncertainty.out_of_distribution.reason.empty())
    row.warning = "out of distribution: " + uncertainty.out_of_distribution.text();
}

Bytes draw(const std::string& title, const std::vector<const TrainedModel*>& models,
           const Dataset& data, std::size_t row) {
  std::vector<Records> seen;
  std::vector<Prediction> made;
  std::vector<std::vector<float>> shown;
  for (const auto* model : models) {
    seen.push_back(prepare_records(*model, part_of(data, {row}), RangeBiasAction::ignore));
    made.push_back(predict(*model, seen.back(), {0},
                           model->uncertainty ? PredictionDetail::pixels : PredictionDetail::maps));
    shown.push_back(within_span(made.back().maps.row(0)));
  }
  std::vector<FigureRow> rows;
  for (std::size_t i = 0; i < models.size(); ++i) {
    const Inputs inputs = models[i]->features.inputs;
    const auto s = score(made[i].maps.row(0), data.depth.row(row), models[i]->scene);
    FigureRow r{mode_title(inputs),
                {},
                data.depth.row(row),
                shown[i],
                {},
                formatted("SSIM %.3f   IoU %.2f", s[metric_ssim], s[metric_iou]),
                {},
                {}};
    r.uncertainty = calibration_of(*models[i]);
    if (models[i]->uncertainty) {
      r.deviation = std::as_const(made[i].deviation).row(0);
      show_uncertainty(r, made[i].uncertainties.front());
    }
    if (inputs != Inputs::radar) r.curves.push_back(spd_curve(seen[i].data, 0));
    if (inputs != Inputs::spd) r.curves.push_back(radar_curve(seen[i].data, 0));
    rows.push_back(std::move(r));
  }
  return figure(title, rows, data.map.half_tangent);
}

// Held-out rows of all models whose label is, or is not, that of a person alone.
Rows labelled(const std::vector<const TrainedModel*>& models, const Dataset& data, bool person) {
  Rows rows = rows_of_both(*models.front(), data);
  for (const auto* model : models) {
    Rows other = rows_to_evaluate(*model, data, false), common;
    std::sort(other.begin(), other.end());
    std::sort(rows.begin(), rows.end());
    std::set_intersection(rows.begin(), rows.end(), other.begin(), other.end(),
                          std::back_inserter(common));
    rows = std::move(common);
  }
  std::erase_if(rows, [&](std::size_t row) { return (data.label[row] == "person") != person; });
  return rows;
}

void add_figures(Report& report, const std::vector<const TrainedModel*>& models,
                 const Dataset& data) {
  for (const bool person : {true, false}) {
    const Rows candidates = labelled(models, data, person);
    if (candidates.empty()) continue;
    const std::size_t row = median_row(*models.front(), data, candidates);
    const std::string what = person ? "person" : "letter";
    const std::string name = formatted("%s (record %lld)", data.label[row].c_str(),
                                       static_cast<long long>(data.index[row]));
    report.pictures.push_back(
        {"figure_" + what + ".png",
         name +
             ": of all held-out records of this kind, the one whose fused reconstruction has the "
             "median IoU.",
         draw(name, models, data, row)});
  }
}

void add_live(Report& report, const TrainedModel& fused, const std::string& path) {
  const Dataset data = load({path});
  const Records records = prepare_records(fused, data, RangeBiasAction::warn);
  const Rows rows = rows_to_evaluate(fused, records.data, false);
  report.live = path;
  report.live_evaluation = evaluate(fused, records, rows);
  report.live_evaluation.baselines = score_baselines(data, rows, fused.scene, data, {});
  const std::size_t row = median_row(fused, data, rows);
  const std::string name = formatted("live record %lld", static_cast<long long>(data.index[row]));
  report.pictures.push_back({"figure_live.png", name + " of " + path + ", recorded by the daemon.",
                             draw(name, {&fused}, data, row)});
}

}  // namespace

void check_report_folder(const ReportOptions& options) {
  if (options.force) return;
  const std::string page = options.dir + "/report.html";
  bool others = false;
  if (std::filesystem::exists(page))
    others = read_text(page).find(record::RunReader(options.run).info().uuid) == std::string::npos;
  else
    for (const char* picture : {"person", "letter", "live"})
      others |= std::filesystem::exists(options.dir + "/figure_" + picture + ".png");
  if (others)
    throw Error(ExitCode::usage, options.dir +
                                     ": holds a report of another run, or pictures under "
                                     "its names; give another folder, or --force to "
                                     "write over them");
}

Report make_report(const ReportOptions& options) {
  const Dataset data = load({options.run});
  std::vector<LoadedMode> modes;
  modes.push_back(score_mode("fused", Inputs::fused, 0.6576, options.fused, data));
  if (!options.paper.empty())
    modes.push_back(score_mode("paper", Inputs::fused, 0.6576, options.paper, data));
  modes.push_back(score_mode("spd", Inputs::spd, 0.6389, options.spd, data));
  modes.push_back(score_mode("radar", Inputs::radar, 0.5266, options.radar, data));
  Report report;
  report.run = options.run;
  report.run_uuid = data.sources.front().uuid;
  std::vector<const TrainedModel*> first;
  for (auto& mode : modes) {
    first.push_back(&mode.models.front());
    report.modes.push_back(std::move(mode.result));
  }
  const TrainedModel& fused = *first.front();
  report.baselines = score_baselines(data, rows_of_both(fused, data), fused.scene, data,
                                     fused.rows_of(data, Part::train));
  report.records = report.modes.front().evaluations.front().records;
  add_figures(report, first, data);
  if (!options.live.empty()) add_live(report, fused, options.live);
  return report;
}

std::string write_report(const Report& report, const std::string& dir) {
  make_folder(dir);
  for (const auto& picture : report.pictures) write_file(dir + "/" + picture.file, picture.png);
  const std::string page = to_html(report), path = dir + "/report.html";
  write_text(path, page);
  return path;
}

}  // namespace echofuse::recon
