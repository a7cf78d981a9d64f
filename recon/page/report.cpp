// SPDX-License-Identifier: MIT
#include "recon/page/report.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <utility>

#include "drivers/program/exit_code.hpp"
#include "drivers/program/new_file.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"
#include "recon/use/empty_room.hpp"
#include "recon/use/map_pictures.hpp"
#include "recon/use/predict.hpp"

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

// Those with the sensors alive that the models ask, on which all can be compared.
Rows comparable_rows(const TrainedModel& model, const Dataset& data, std::optional<Inputs> asked) {
  Rows rows = rows_to_evaluate(model, data, false);
  std::erase_if(rows, [&](auto row) { return asked && !data.fault_of(row, *asked).empty(); });
  if (rows.empty())
    throw Error(ExitCode::failed, data.sources.front().path +
                                      ": no record with depth has all sensors of these models, " +
                                      "which they are compared on");
  return rows;
}

// This is where the true map has what stands out from the background.
RecordFacts facts_of(const Dataset& data, std::size_t row, const Scene& scene) {
  const Axis x = scene.grid.x();
  const auto map = data.depth.row(row);
  double range = 0, side = 0, pixels = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    if (!true_foreground(map[p], scene.background[p])) continue;
    range += double{map[p]}, ++pixels;
    side += x.at(static_cast<double>(p % x.count)) * double{map[p]};
  }
  return {data.index[row], data.label[row], range / pixels, side / pixels};
}

ModelFacts model_facts(const std::string& file, const TrainedModel& model) {
  ModelFacts out{
      file,       model->name, model->fit.seed, model.split.seed, model.data_hash, 0, 0, 0,
      model->log, false};
  const Candidate paper = candidate_of("paper", {});
  out.papers = model->name == paper.model && model->model->sizes().hidden == paper.fit.hidden;
  for (const std::uint8_t part : model.seen.part)
    ++(part == static_cast<std::uint8_t>(Part::train)        ? out.train
       : part == static_cast<std::uint8_t>(Part::validation) ? out.validation
                                                             : out.test);
  return out;
}

// Answers every record with the same map.
bool is_constant(const TrainedModel& model) {
  return model->name == "mean" || model->name == "empty";
}

TrainedModel model_for(const std::string& path, const ReportOptions& options, Report& report) {
  TrainedModel model = load_model(path);
  if (!options.empty.empty()) report.room = take_to_room(model, options.empty);
  return model;
}

std::string takes(const TrainedModel& model) {
  if (is_constant(model)) return "no sensor";
  const Features& f = model->features;
  if (!both_sensors(f.inputs)) return f.inputs == Inputs::spd ? "SPD alone" : "radar alone";
  if (f.array_count() == 0) return "SPD + radar profile";
  // A row without gaps tells the number of antennas.
  return f.array_axis.quantity == "lags" ? formatted("SPD + %.0f antennas", f.array_axis.scale + 1)
                                         : "SPD + antennas";
}

// Takes FILE or NAME=FILE: a seed of the mode of that name, or a mode behind the last of equal
// inputs. Compared models stay as they are given.
void add_model(std::vector<LoadedMode>& modes, const std::string& given,
               const ReportOptions& options, Report& report) {
  const bool compared = !options.compare.empty();
  const auto equals = given.find('=');
  const bool named = !compared && equals < given.find('/');
  const std::string path = named ? given.substr(equals + 1) : given;
  const std::string name = compared ? given
                           : named  ? given.substr(0, equals)
                                    : std::filesystem::path(given).stem().string();
  TrainedModel model = model_for(path, options, report);
  const std::string own = takes(model);
  auto at = std::ranges::find_if(
      modes, [&](const LoadedMode& m) { return !compared && m.result.name == name; });
  if (at == modes.end()) {
    const auto like = std::find_if(modes.rbegin(), modes.rend(), [&](const LoadedMode& m) {
      return compared || m.result.takes == own;
    });
    at = modes.insert(like == modes.rend() ? modes.end() : like.base(),
                      LoadedMode{{name, model->features.inputs, own, {}, {}, {}, {}}, {}});
  } else if (at->result.takes != own) {
    throw Error(ExitCode::failed, path + ": takes " + own + ", and " +
                                      at->result.models.front().file + " of the same name " +
                                      at->result.takes + "; expected --model NAME=" + path);
  }
  at->result.models.push_back(model_facts(path, model));
  at->models.push_back(std::move(model));
}

// The sensors that these models ask together; none of constant maps.
std::optional<Inputs> asked_by(const std::vector<LoadedMode>& modes) {
  std::optional<Inputs> out;
  for (const LoadedMode& mode : modes) {
    if (is_constant(mode.models.front())) continue;
    const Inputs own = mode.result.inputs;
    out = out && *out != own ? Inputs::fused : own;
  }
  return out;
}

// Each model brings a copy of the data onto its own axes.
void score(LoadedMode& mode, const Dataset& data, std::optional<Inputs> asked, bool quiet,
           std::optional<Judge>& judge) {
  for (const TrainedModel& model : mode.models) {
    const Records records = prepare_records(model, data);
    const Rows rows = comparable_rows(model, records.data, asked);
    Evaluation e =
        evaluate(model, records, rows, quiet ? "" : "scoring " + mode.result.name, judge);
    judge = e.judge;
    e.left_out += rows_to_evaluate(model, records.data, false).size() - rows.size();
    const std::size_t k = mode.result.evaluations.size();
    e.cost = measure_cost(model, records.data, rows, mode.result.models[k].file);
    if (k == 0)
      for (const std::size_t row : rows)
        mode.result.records.push_back(facts_of(records.data, row, e.judge.scene));
    mode.result.evaluations.push_back(std::move(e));
  }
  mode.result.metrics = over_models(mode.result.evaluations);
}

double quality(const MapScores& scores) {
  return std::isnan(scores[metric_iou]) ? 0 : scores[metric_iou];
}

// It returns those of the subject's records that `wanted` takes, the worst by quality first: a row
// of the data each.
Rows by_quality(const ModeResult& subject, const std::function<bool(std::size_t)>& wanted) {
  const Evaluation& e = subject.evaluations.front();
  std::vector<std::pair<double, std::size_t>> order;
  for (std::size_t i = 0; i < e.rows.size(); ++i)
    if (wanted(e.rows[i])) order.emplace_back(quality(e.scores[i]), e.rows[i]);
  std::sort(order.begin(), order.end());
  Rows out;
  for (const auto& [iou, row] : order) out.push_back(row);
  return out;
}

// The record that is nearest to the middle of the order of each model with the subject's inputs;
// none of none.
std::optional<std::size_t> middle_row(const Report& report,
                                      const std::function<bool(std::size_t)>& wanted) {
  std::map<std::size_t, std::size_t> off;  // at most so many places from a middle, by row
  for (const ModeResult& mode : report.modes) {
    if (mode.takes != report.modes.front().takes) continue;
    const Rows rows = by_quality(mode, wanted);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const std::size_t middle = rows.size() / 2;
      off[rows[i]] = std::max(off[rows[i]], i > middle ? i - middle : middle - i);
    }
  }
  const auto least = std::ranges::min_element(off, {}, [](const auto& one) { return one.second; });
  return least == off.end() ? std::nullopt : std::optional(least->first);
}

// No picked cherries: of each kind the record of median quality; then the ends.
void add_records(Report& report, const std::vector<const TrainedModel*>& models,
                 const std::vector<std::string>& names, const Dataset& data) {
  const ModeResult& subject = report.modes.front();
  Rows common = subject.evaluations.front().rows;
  std::sort(common.begin(), common.end());
  for (const ModeResult& mode : report.modes) {
    Rows other = mode.evaluations.front().rows, both;
    std::sort(other.begin(), other.end());
    std::set_intersection(common.begin(), common.end(), other.begin(), other.end(),
                          std::back_inserter(both));
    common = std::move(both);
  }
  for (const bool person : {true, false}) {
    const auto wanted = [&](std::size_t row) {
      return (data.label[row] == "person") == person &&
             std::binary_search(common.begin(), common.end(), row);
    };
    const auto row = middle_row(report, wanted);
    if (!row) continue;
    ShownRecord shown = show_record(models, names, data, *row, report.judge->scene);
    shown.caption = formatted(
        "Of all %zu records of this kind the one nearest to the median IoU of each model "
        "with these inputs.",
        by_quality(subject, wanted).size());
    report.main.push_back(std::move(shown));
  }
  const Rows rows = by_quality(subject, [](std::size_t) { return true; });
  const std::vector<const TrainedModel*> first{models.front()};
  for (const auto& [what, share] : {std::pair{"Worst", 0.0}, {"Median", 0.5}, {"Best", 1.0}}) {
    const auto at = static_cast<std::size_t>(share * static_cast<double>(rows.size() - 1));
    report.gallery.push_back(
        show_record(first, {names.front()}, data, rows[at], report.judge->scene));
    report.gallery.back().title.insert(0, std::string(what) + ": ");
  }
}

void add_live(Report& report, const TrainedModel& model, const std::string& name,
              const std::string& path) {
  const Dataset data = load({path});
  const Records records = prepare_records(model, data);
  const Rows rows = rows_to_evaluate(model, records.data, false);
  ModeResult live{"live", model->features.inputs, {}, {evaluate(model, records, rows)}, {}, {}, {}};
  report.live = live.evaluations.front();
  report.live->baselines = score_baselines(data, rows, report.live->judge.scene, data, {});
  const Rows order = by_quality(live, [](std::size_t) { return true; });
  ShownRecord shown =
      show_record({&model}, {name}, data, order[order.size() / 2], report.live->judge.scene);
  shown.caption = "Of the records that the daemon recorded, the one whose map has the median IoU.";
  report.main.push_back(std::move(shown));
}

void add_comparison(Report& report) {
  const Evaluation &a = report.modes[0].evaluations.front(),
                   &b = report.modes[1].evaluations.front();
  if (a.rows != b.rows)
    throw Error(ExitCode::failed,
                "the two models hold other records out; give a run that neither was trained on");
  report.differences = paired_differences(a.scores, b.scores);
  for (std::size_t i = 0; i < a.scores.size(); ++i) {
    MapScores difference;
    for (std::size_t m = 0; m < metric_count; ++m)
      difference[m] = gain(static_cast<Metric>(m), a.scores[i][m], b.scores[i][m]);
    report.paired.push_back(difference);
  }
}

void add_models(Report& report, const ReportOptions& options, const Dataset& data) {
  std::vector<LoadedMode> modes;
  for (const auto* given : {&options.models, &options.compare})
    for (const std::string& model : *given) add_model(modes, model, options, report);
  const std::optional<Inputs> asked = asked_by(modes);
  for (const LoadedMode& mode : modes)
    for (const TrainedModel& model : mode.models)
      if (!report.judge && model.knows(data)) report.judge = judge_of(model, data);
  for (LoadedMode& mode : modes) score(mode, data, asked, options.quiet, report.judge);
  std::vector<const TrainedModel*> first;
  std::vector<std::string> names;
  for (auto& mode : modes) {
    first.push_back(&mode.models.front());
    names.push_back(title_of(mode.result));
    report.modes.push_back(std::move(mode.result));
  }
  const TrainedModel& subject = *first.front();
  report.baselines =
      score_baselines(data, comparable_rows(subject, data, asked), report.judge->scene, data,
                      subject.rows_of(data, Part::train), options.quiet ? "" : "scoring baselines");
  report.records = report.modes.front().evaluations.front().records;
  report.span = span_of(subject->scene), report.new_run = !subject.knows(data);
  add_records(report, first, names, data);
  if (!options.compare.empty()) add_comparison(report);
  if (!options.live.empty()) add_live(report, subject, names.front(), options.live);
}

std::string run_of(const ReportOptions& options) {
  return options.run.empty() ? options.live : options.run;
}

}  // namespace

void check_report(const ReportOptions& o) {
  const bool models = !o.models.empty();
  std::string fault;
  if (run_of(o).empty()) fault = "nothing to report on: give --run with models, or --live";
  if (!o.run.empty() && !models && o.compare.empty()) fault = "--run needs --model or --compare";
  if (o.run.empty() && (models || !o.compare.empty())) fault = "models need --run";
  if (models && !o.compare.empty()) fault = "--compare takes the place of the other models";
  if (!o.compare.empty() && o.compare.size() != 2) fault = "--compare takes two models";
  if (!o.empty.empty() && o.run.empty()) fault = "--empty is for the models of --run";
  if (!fault.empty()) throw Error(ExitCode::usage, fault);
  if (o.force) return;
  const std::string page = o.dir + "/report.html";
  if (std::filesystem::exists(page) &&
      read_text(page).find(record::RunReader(run_of(o)).info().uuid) == std::string::npos)
    throw Error(ExitCode::usage, o.dir +
                                     ": holds a report of another run; give another folder, or "
                                     "--force to write over it");
}

Report make_report(const ReportOptions& options) {
  Report report;
  report.run = run_of(options);
  std::optional<Dataset> data;
  if (!options.run.empty()) {
    data = load({options.run});
    add_models(report, options, *data);
  }
  if (!options.live.empty()) report.story = story_of(options.live);
  const record::RunInfo info = record::RunReader(report.run).info();
  report.run_uuid = info.uuid, report.window_s = info.window_s;
  report.simulated = info.notes.starts_with("simulated");
  report.made = how_made(options, report, data ? &*data : nullptr);
  return report;
}

std::string write_report(const Report& report, const std::string& dir) {
  make_folder(dir);
  const std::string path = dir + "/report.html";
  write_atomically(path, html_of(page_of(report)));
  return path;
}

}  // namespace echofuse::recon
