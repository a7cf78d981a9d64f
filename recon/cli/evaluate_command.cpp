// SPDX-License-Identifier: MIT
// `evaluate`: the one judge of models and of maps that any program has written.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "drivers/program/command_line.hpp"
#include "drivers/program/console.hpp"
#include "drivers/program/csv.hpp"
#include "drivers/program/printable.hpp"
#include "recon/cli/commands.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/text.hpp"
#include "recon/use/evaluate.hpp"
#include "recon/use/paired.hpp"
#include "recon/use/written_maps.hpp"

namespace echofuse::recon {
namespace {

struct Arguments {
  std::vector<std::string> files, maps, train;  // files: models, and last the run
  std::string empty, records;
  double range_offset_m = 0;
  bool all = false, json = false;
};

// Scores of one way to make maps, on the rows of all.
struct Judged {
  std::string name;
  std::vector<MapScores> scores;
};

void put(const nlohmann::json& json) {
  std::puts(json.dump(2, ' ', true, nlohmann::json::error_handler_t::replace).c_str());
}

// A line for each record and row.
void write_records(const std::string& path, const Dataset& data, const Rows& rows,
                   const std::vector<Judged>& all) {
  std::string out = "record,label,name";
  for (const char* metric : metric_names) out += std::string(",") + metric;
  out += '\n';
  for (std::size_t i = 0; i < rows.size(); ++i)
    for (const Judged& one : all) {
      out += formatted("%lld,", static_cast<long long>(data.index[rows[i]])) +
             csv_text(data.label[rows[i]]) + ',' + csv_text(one.name);
      for (const double score : one.scores[i])
        out += std::isnan(score) ? "," : formatted(",%.9g", score);
      out += '\n';
    }
  write_file(path, Bytes(out.begin(), out.end()));
}

// Differences of the second and later rows to the first, with intervals of 95 %.
std::string paired_text(const std::vector<Judged>& all) {
  std::string out;
  for (std::size_t k = 1; k < all.size(); ++k)
    for (const PairedDifference& d : paired_differences(all[0].scores, all[k].scores))
      if (d.metric == metric_iou || d.metric == metric_lateral_m)
        out += formatted("%s against %s: %s better by %.4f (95 %%: %.4f to %.4f)\n",
                         all[k].name.c_str(), all[0].name.c_str(), metric_names[d.metric], d.mean,
                         d.low, d.high);
  return out;
}

ExitCode evaluate_model(const Arguments& a, const Common& common) {
  const auto title = [&](const char* text) { return common.quiet || a.json ? "" : text; };
  const std::string &path = a.files[0], &run = a.files[1];
  const TrainedModel model = model_for_room(path, a.empty, a.range_offset_m);
  Dataset data = load_recorded({run}), other;
  const Records records = prepare_records(model, data, a.range_offset_m);
  subtract_range_offset(data, a.range_offset_m);
  if (!a.train.empty()) {
    other = load(a.train);
    require_map(other, model->scene.grid, "the model");
  }
  const Dataset& trained_on = a.train.empty() ? data : other;
  const Rows rows = rows_to_evaluate(model, records.data, a.all);
  const Judge judge = a.train.empty() ? judge_of(model, records.data) : judge_of(other);
  Evaluation e = evaluate(model, records, rows, title("scoring"), judge);
  const Rows neighbours = a.train.empty() ? model.rows_of(trained_on, Part::train)
                                          : trained_on.usable(model->features.inputs);
  e.baselines =
      score_baselines(data, rows, judge.scene, trained_on, neighbours, title("scoring baselines"));
  set_threads(1);
  e.cost = measure_cost(model, records.data, rows, path);
  if (!a.records.empty()) write_records(a.records, data, rows, {{e.model, e.scores}});
  if (a.json)
    put(to_json(e));
  else
    std::puts(printable_lines(to_text(e)).c_str());
  return ExitCode::ok;
}

// Folders of maps, and models, on the records that all of them have.
ExitCode evaluate_maps(const Arguments& a, const Common& common) {
  const auto title = [&](const char* text) { return common.quiet || a.json ? "" : text; };
  const std::string& run = a.files.back();
  Dataset data = load_recorded({run});
  std::vector<TrainedModel> models;
  for (std::size_t k = 0; k + 1 < a.files.size(); ++k)
    models.push_back(model_for_room(a.files[k], a.empty, a.range_offset_m));
  std::vector<Records> records;
  for (const TrainedModel& model : models)
    records.push_back(prepare_records(model, data, a.range_offset_m));
  subtract_range_offset(data, a.range_offset_m);
  Dataset other;
  if (!a.train.empty()) {
    other = load(a.train);
    require_map(other, data.map, run);
  }
  const Judge judge = !a.train.empty()  ? judge_of(other)
                      : !models.empty() ? judge_of(models[0], records[0].data)
                                        : judge_of(data);
  std::vector<WrittenMaps> written;
  for (const std::string& folder : a.maps) written.push_back(read_written_maps(folder, data.map));
  Rows rows = rows_with_maps(written, data);
  for (std::size_t k = 0; k < models.size(); ++k) {
    Rows of_model = rows_to_evaluate(models[k], records[k].data, a.all);
    std::ranges::sort(of_model);
    std::erase_if(rows, [&](auto row) { return !std::ranges::binary_search(of_model, row); });
  }
  if (rows.empty()) throw Error(ExitCode::failed, run + ": no record of which all have a map");

  std::vector<Judged> all;
  for (const WrittenMaps& maps : written)
    all.push_back({maps.name, score_maps(maps_of(maps, data, rows), data, rows, judge.scene)});
  for (std::size_t k = 0; k < models.size(); ++k)
    all.push_back({std::filesystem::path(a.files[k]).stem().string(),
                   evaluate(models[k], records[k], rows, title("scoring"), judge).scores});
  const std::vector<ScoredRow> baselines = score_baselines(
      data, rows, judge.scene, a.train.empty() ? data : other,
      a.train.empty() ? Rows{} : other.usable(Inputs::fused), title("scoring baselines"));
  if (!a.records.empty()) write_records(a.records, data, rows, all);
  std::vector<ScoredRow> scored;
  for (const Judged& one : all) scored.push_back({one.name, summarise(one.scores)});
  const std::string note = a.train.empty() && models.empty()
                               ? "foreground and background are those of this run's own maps; "
                                 "--train RUN names others"
                               : judge.note;
  if (a.json) {
    put(to_json(scored, baselines, rows.size(), note));
  } else {
    std::vector<ScoredRow> table = scored;
    table.insert(table.end(), baselines.begin(), baselines.end());
    std::puts(
        printable_lines(formatted("%zu records; mean +- standard error over maps\n", rows.size()) +
                        (note.empty() ? "" : note + "\n") + to_table(table) + paired_text(all))
            .c_str());
  }
  return ExitCode::ok;
}

}  // namespace

Command add_evaluate(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<Arguments>();
  app.add_option("files", a->files,
                 "a model file, and last the run file; with --maps any number of models")
      ->type_name("MODEL ... RUN")
      ->required();
  app.add_option(
         "--maps", a->maps,
         "folders of maps of any program: maps.npy [n, N, N] in metres with records.csv, or "
         "16-bit PNGs with camera.json; each --maps one folder")
      ->type_name("FOLDER")
      ->allow_extra_args(false);
  app.add_flag("--all", a->all, "also score records that the model was trained on");
  app.add_option("--train", a->train,
                 "the training runs of a fresh run: they say what is foreground and background, "
                 "and have the nearest neighbours")
      ->type_name("RUN")
      ->allow_extra_args(false);
  app.add_option("--records", a->records, "table of the scores of each record to write")
      ->type_name("FILE");
  add_empty_option(app, a->empty);
  add_range_offset_option(app, a->range_offset_m);
  app.add_flag("--json", a->json, "one JSON object instead of text");
  more_options(app, {"--train", "--records", "--empty", "--range-offset", "--json"});
  add_examples(app, {"echofuse-recon evaluate fused.safetensors scenes.sqlite",
                     "echofuse-recon evaluate --maps mine fresh.sqlite --train scenes.sqlite"});
  return [a, &common] {
    if (!a->maps.empty()) return evaluate_maps(*a, common);
    if (a->files.size() != 2)
      throw Error(ExitCode::usage, "expected MODEL RUN, or --maps FOLDER [MODEL ...] RUN");
    return evaluate_model(*a, common);
  };
}

}  // namespace echofuse::recon
