// SPDX-License-Identifier: MIT
// `evaluate`: scores models, and depth maps made by other programs.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <span>

#include "drivers/core/crc32c.hpp"
#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/cli/commands.hpp"
#include "recon/data/files.hpp"
#include "recon/maps/written_maps.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/score/evaluate.hpp"
#include "recon/score/paired.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {
namespace {

struct Arguments {
  std::vector<std::string> files, maps, train;  // `files`: model files, followed by the run file
  std::string empty, per_record, rows;
  double range_offset_m = 0;
  bool all = false, json = false;
};

// Scores of one method for the records in `rows`. `stated` contains the estimated errors, and is
// empty if the method does not estimate errors.
struct MethodScores {
  std::string name;
  Rows rows;
  std::vector<MapScores> scores;
  std::vector<PredictionUncertainty> stated = {};
};

void put(nlohmann::json json) {
  json["schema"] = 1;
  std::puts(json.dump(2, ' ', true, nlohmann::json::error_handler_t::replace).c_str());
}

// Returns the mean depth and the mean x of the foreground in a ground-truth depth map, in metres,
// as two CSV fields.
std::string place_of(std::span<const float> truth, const SceneModel& scene) {
  const Axis x = scene.grid.x();
  double range_m = 0, side_m = 0, pixels = 0;
  for (std::size_t p = 0; p < truth.size(); ++p) {
    if (!true_foreground(truth[p], scene.background[p])) continue;
    range_m += double{truth[p]}, ++pixels;
    side_m += x.at(static_cast<double>(p % x.count)) * double{truth[p]};
  }
  return pixels > 0 ? format("%.9g,%.9g", range_m / pixels, side_m / pixels) : ",";
}

// Writes a CSV table with one line per method and record.
void write_records(const std::string& path, const Dataset& data, const SceneModel& scene,
                   const std::vector<MethodScores>& all) {
  std::string out = "record,label,name";
  for (const char* metric : metric_names) out += std::string(",") + metric;
  out += ",range_m,side_m,lateral_interval_90_m,out_of_distribution\n";
  for (const MethodScores& one : all)
    for (std::size_t i = 0; i < one.rows.size(); ++i) {
      const std::size_t row = one.rows[i];
      out += format("%lld,", static_cast<long long>(data.records[row].index)) +
             csv_text(printable(data.records[row].label)) + ',' + csv_text(printable(one.name));
      const auto number = [](double value) {
        return std::isnan(value) ? "," : format(",%.9g", value);
      };
      for (const double score : one.scores[i]) out += number(score);
      out += ',' + place_of(data.depth().row(row), scene);
      const PredictionUncertainty stated =
          i < one.stated.size() ? one.stated[i] : PredictionUncertainty{};
      out += number(i < one.stated.size() ? stated.lateral_interval_90_m : std::nan("")) + ',' +
             csv_text(stated.out_of_distribution.text()) + '\n';
    }
  write_file(path, Bytes(out.begin(), out.end()));
}

// Compares method k with the first method. Returns an empty list if the two methods have different
// records.
std::vector<PairedDifference> differences_of(const std::vector<MethodScores>& all, std::size_t k) {
  if (all[k].rows != all[0].rows) return {};
  return paired_differences(all[0].scores, all[k].scores);
}

// Describes how much better each method is than the first method, with 95 % confidence intervals.
std::string paired_text(const std::vector<MethodScores>& all) {
  std::string out;
  for (std::size_t k = 1; k < all.size(); ++k)
    for (const PairedDifference& d : differences_of(all, k))
      if (d.metric == metric_iou || d.metric == metric_lateral_m)
        out += format("%s vs %s: %s better by %.4f (%s)\n", all[k].name.c_str(),
                      all[0].name.c_str(), metric_names[d.metric], d.mean,
                      std::isnan(d.low) ? "too few records for an interval"
                                        : format("95 %%: %.4f to %.4f", d.low, d.high).c_str());
  return out;
}

nlohmann::json paired_json(const std::vector<MethodScores>& all) {
  auto out = nlohmann::json::array();
  for (std::size_t k = 1; k < all.size(); ++k)
    out.push_back({{"model", all[k].name}, {"metrics", to_json(differences_of(all, k))}});
  return out;
}

// Returns the sensors needed by at least one of `models`; empty if all models return a constant
// map.
std::optional<Inputs> inputs_needed_by(const std::vector<TrainedModel>& models) {
  std::optional<Inputs> out;
  for (const TrainedModel& model : models)
    if (const Inputs own = model.first().features.inputs;
        model.first().name != "mean" && model.first().name != "empty")
      out = out && *out != own ? Inputs::fused : own;
  return out;
}

// Loads all models named in the arguments, and adapts them to the empty room. The last argument is
// the run.
std::vector<TrainedModel> models_for_room(const Arguments& a) {
  std::vector<TrainedModel> out;
  for (std::size_t k = 0; k + 1 < a.files.size(); ++k)
    out.push_back(model_for_room(a.files[k], a.empty, a.range_offset_m));
  return out;
}

void print_evaluations(const std::vector<Evaluation>& all, const std::vector<MethodScores>& scored,
                       const Dataset& data, bool json) {
  if (json) {
    nlohmann::json out = to_json(all[0]), rows = nlohmann::json::array();
    for (const Evaluation& e : all) rows.push_back(to_json(e));
    out["data_crc32c"] = crc32c_of(data);
    if (all.size() > 1) out["rows"] = rows, out["paired"] = paired_json(scored);
    put(out);
    return;
  }
  std::string text;
  for (std::size_t k = 0; k < all.size(); ++k)
    text += (k > 0 ? "\n" : "") + (all.size() > 1 ? scored[k].name + ": " : "") + to_text(all[k]);
  print(printable_lines(text + paired_text(scored)));
}

// Throws Error(failed) if the scored run is also a training run, unless each folder states which
// records were used for training. These records are not scored.
void refuse_training_run(const Dataset& scored, const Dataset& trained_on,
                         const std::vector<WrittenMaps>& folders) {
  const auto states_records = [](const WrittenMaps& maps) { return !maps.trained_on.empty(); };
  if (!folders.empty() && std::ranges::all_of(folders, states_records)) return;
  const Source& run = scored.sources.front();
  if (std::ranges::find(trained_on.sources, run.uuid, &Source::uuid) != trained_on.sources.end())
    throw Error(ExitCode::failed, printable(run.path) + ": is a training run; score another run");
}

ExitCode evaluate_models(const Arguments& a, const Common& common) {
  const std::string& run = a.files.back();
  const std::size_t count = a.files.size() - 1;
  const auto title = [&](const std::string& text) {
    return common.quiet || a.json ? std::string() : text;
  };
  const std::vector<TrainedModel> models = models_for_room(a);
  Dataset recorded = load_recorded({run}), data = recorded, other;
  subtract_range_offset(data, a.range_offset_m);
  if (!a.train.empty()) {
    other = load(a.train);
    if (!a.all) refuse_training_run(data, other, {});
    require_map(other, models[0].first().scene.grid, "the model");
  }
  const Dataset& trained_on = a.train.empty() ? data : other;
  const std::optional<Inputs> needed = count > 1 ? inputs_needed_by(models) : std::nullopt;
  std::optional<ScoringScene> scoring;
  if (!a.train.empty()) scoring = scoring_scene(other);
  for (const TrainedModel& model : models)
    if (!scoring && model.was_trained_on(data)) scoring = scoring_scene(model, data);
  std::vector<Evaluation> all;
  std::vector<MethodScores> scored;
  for (std::size_t k = 0; k < count; ++k) {
    const TrainedModel& model = models[k];
    const Records records =
        prepare_records(model, k + 1 < count ? recorded : std::move(recorded), a.range_offset_m);
    const Rows whole = rows_to_evaluate(model, records.data, a.all);
    Rows rows = whole;
    std::erase_if(
        rows, [&](auto row) { return needed && !fault_of(records.data, row, *needed).empty(); });
    if (rows.empty())
      throw Error(
          ExitCode::failed,
          run + ": no record contains a depth map and data of all sensors that these models use");
    const std::string name = std::filesystem::path(a.files[k]).stem().string();
    if (!scoring) scoring = scoring_scene(model, records.data);
    Evaluation e = evaluate(model, records, rows, title("scoring " + name), scoring);
    if (const std::size_t lacking = whole.size() - rows.size(); lacking > 0)
      e.left_out += lacking, e.faults["no data from a sensor that another model needs"] += lacking;
    if (k == 0)
      e.baselines =
          score_baselines(data, rows, scoring->scene, trained_on,
                          a.train.empty() ? model.rows_of(trained_on, Subset::train)
                                          : usable(trained_on, model.first().features.inputs),
                          title("scoring baselines"));
    set_threads(1);
    e.cost = measure_cost(model, records.data, rows, a.files[k]);
    set_threads(common.threads);
    scored.push_back({count > 1 ? name : e.model, rows, e.scores, e.uncertainties});
    all.push_back(std::move(e));
  }
  if (!a.per_record.empty()) write_records(a.per_record, data, scoring->scene, scored);
  print_evaluations(all, scored, data, a.json);
  return ExitCode::ok;
}

// Returns warnings about ground-truth depth maps that contradict the sensor data.
std::vector<std::string> notes_on_truth(const Dataset& data, const std::vector<ScoredRow>& scored) {
  std::vector<std::string> out{faults_of_truth(data)};
  for (const ScoredRow& row : scored)
    if (const std::string line = mirrored_truth(row.metrics); !line.empty())
      out.push_back(row.name + ": " + line);
  std::erase(out, "");
  return out;
}

// Marks the records excluded by --rows. `test` keeps only the test records of the default split;
// `listed` keeps only the records listed in the records.csv file of at least one folder.
void exclude_unselected(const std::string& selection, const std::vector<WrittenMaps>& folders,
                        const Dataset& data, std::vector<std::string>& left_out) {
  if (selection.empty()) return;
  std::set<std::int64_t> expected;
  if (selection == "test") {
    for (const std::size_t row : make_split(rows_to_train(data, inputs_of(data)).rows, {}).test)
      expected.insert(data.records[row].index);
  } else {
    for (const WrittenMaps& maps : folders) {
      for (const auto& [index, map] : maps.of_index) expected.insert(index);
      expected.insert(maps.without.begin(), maps.without.end());
    }
  }
  for (std::size_t row = 0; row < left_out.size(); ++row)
    if (!expected.contains(data.records[row].index)) left_out[row] = "excluded by --rows";
}

// Returns, for each record, the reason why it is not scored; empty if it is scored.
std::vector<std::string> reasons_left_out(const Arguments& a,
                                          const std::vector<WrittenMaps>& written,
                                          const Dataset& data,
                                          const std::vector<TrainedModel>& models,
                                          const std::vector<Records>& records) {
  std::vector<std::string> out = left_out_of_maps(written, data, a.all);
  exclude_unselected(a.rows, written, data, out);
  for (std::size_t k = 0; k < models.size(); ++k) {
    const auto of_model = left_out_of_evaluation(models[k], records[k].data, a.all);
    for (std::size_t row = 0; row < out.size(); ++row)
      if (out[row].empty()) out[row] = of_model[row];
  }
  return out;
}

// Scores of map folders and models on the same records. Folders come before models.
struct ScoredMaps {
  std::vector<MethodScores> all;
  std::vector<std::size_t> answered;  // for each folder: number of records with a map
  std::string unanswered;             // messages about folders that lack maps
};

void add_folder(ScoredMaps& out, const WrittenMaps& maps, const Dataset& data, const Rows& rows,
                const SceneModel& scene) {
  out.answered.push_back(count_maps(maps, data, rows));
  if (out.answered.back() < rows.size())
    out.unanswered +=
        format("%s: %zu of %zu records have a map; missing maps are replaced by the empty room\n",
               maps.name.c_str(), out.answered.back(), rows.size());
  out.all.push_back({maps.name, rows,
                     score_maps(maps_of(maps, data, rows, scene.background), data, rows, scene)});
}

nlohmann::json maps_json(const ScoredMaps& maps, const std::vector<ScoredRow>& scored,
                         const std::vector<ScoredRow>& baselines, std::size_t rows,
                         const std::string& note) {
  nlohmann::json out = to_json(scored, baselines, rows, note);
  out["answered"] = maps.answered[0];
  out["paired"] = paired_json(maps.all);
  for (std::size_t k = 0; k < maps.all.size(); ++k)
    out["rows"][k]["answered"] = k < maps.answered.size() ? maps.answered[k] : rows;
  return out;
}

// Evaluates folders of maps together with models. If a folder has no map for a record, the map of
// the empty room is scored instead.
ExitCode evaluate_maps(const Arguments& a, const Common& common) {
  const auto title = [&](const char* text) { return common.quiet || a.json ? "" : text; };
  const std::string& run = a.files.back();
  Dataset data = load_recorded({run}), other;
  const std::vector<TrainedModel> models = models_for_room(a);
  std::vector<Records> records;
  for (const TrainedModel& model : models)
    records.push_back(prepare_records(model, data, a.range_offset_m));
  subtract_range_offset(data, a.range_offset_m);
  if (!a.train.empty()) {
    other = load(a.train);
    require_map(other, data.map, run);
  }
  const ScoringScene scoring = !a.train.empty()  ? scoring_scene(other)
                               : !models.empty() ? scoring_scene(models[0], records[0].data)
                                                 : scoring_scene(data);
  std::vector<WrittenMaps> written;
  for (const std::string& folder : a.maps) written.push_back(read_written_maps(folder, data.map));
  if (models.empty() && a.rows.empty() && !a.all) refuse_training_run(data, other, written);
  const std::vector<std::string> left_out = reasons_left_out(a, written, data, models, records);
  Rows rows;
  std::map<std::string, std::size_t> reasons{{"damaged", data.damaged.size()}};
  for (std::size_t row = 0; row < left_out.size(); ++row)
    left_out[row].empty() ? rows.push_back(row) : void(++reasons[left_out[row]]);
  std::erase_if(reasons, [](const auto& reason) { return reason.second == 0; });
  const std::string left_out_line = left_out_text(reasons, data.size() + data.damaged.size());
  if (rows.empty()) throw Error(ExitCode::failed, run + ": no record to score: " + left_out_line);

  ScoredMaps maps;
  for (const WrittenMaps& folder : written) add_folder(maps, folder, data, rows, scoring.scene);
  for (std::size_t k = 0; k < models.size(); ++k)
    maps.all.push_back({std::filesystem::path(a.files[k]).stem().string(), rows,
                        evaluate(models[k], records[k], rows, title("scoring"), scoring).scores});
  const std::vector<ScoredRow> baselines = score_baselines(
      data, rows, scoring.scene, a.train.empty() ? data : other,
      a.train.empty() ? Rows{} : usable(other, Inputs::fused), title("scoring baselines"));
  if (!a.per_record.empty()) write_records(a.per_record, data, scoring.scene, maps.all);
  std::vector<ScoredRow> scored;
  for (const MethodScores& one : maps.all) scored.push_back({one.name, summarise(one.scores)});
  std::string note = a.train.empty() && models.empty()
                         ? "foreground and background are learnt from the depth maps of this run; "
                           "use --train RUN to learn them from other runs"
                         : scoring.note;
  for (const std::string& line : notes_on_truth(data, scored))
    note += (note.empty() ? "" : "\n") + line;
  if (a.json) {
    nlohmann::json out = maps_json(maps, scored, baselines, rows.size(), note);
    out["left_out"] = reasons;
    out["foreground_depth_m"] = scoring.scene.foreground_depth_m;
    put(out);
  } else {
    std::vector<ScoredRow> table = scored;
    table.insert(table.end(), baselines.begin(), baselines.end());
    print(printable_lines(format("%zu records; mean +- standard error over maps\n", rows.size()) +
                          (left_out_line.empty() ? "" : left_out_line + "\n") + maps.unanswered +
                          (note.empty() ? "" : note + "\n") + to_table(table) +
                          paired_text(maps.all)));
  }
  return ExitCode::ok;
}

}  // namespace

Command add_evaluate(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<Arguments>();
  app.add_option(
         "files", a->files,
         "model files, then the run file; every further model is compared with the first model")
      ->type_name("MODEL ... RUN")
      ->required();
  app.add_option("--maps", a->maps,
                 "score the depth maps in this folder, which any program may have written: "
                 "maps.npy ([n, N, N], m) "
                 "with records.csv, or 16-bit PNG files with camera.json; may be repeated")
      ->type_name("FOLDER")
      ->allow_extra_args(false);
  app.add_flag("--all", a->all, "also score the records on which the model was trained");
  app.add_option("--train", a->train,
                 "training runs, which define the foreground and the background and provide the "
                 "neighbours of the nearest-neighbour baseline")
      ->type_name("RUN")
      ->allow_extra_args(false);
  app.add_option("--rows", a->rows,
                 "records to score, one of: test (the test part of the default split), listed (the "
                 "records in records.csv)")
      ->type_name("ROWS")
      ->check(CLI::IsMember({"test", "listed"}))
      ->needs("--maps");
  app.add_option("--per-record", a->per_record,
                 "write the scores, the true position and the estimated error of each record to "
                 "this CSV file")
      ->type_name("FILE");
  add_empty_option(app, a->empty);
  add_range_offset_option(app, a->range_offset_m);
  app.add_flag("--json", a->json, "print JSON instead of text");
  more_options(app, {"--train", "--rows", "--per-record", "--empty", "--range-offset", "--json"});
  add_examples(app,
               {"echofuse-recon evaluate fused.safetensors scenes.sqlite",
                "echofuse-recon evaluate small.safetensors fused.safetensors scenes.sqlite",
                "echofuse-recon evaluate --maps mine fresh.sqlite --train scenes.sqlite"},
               "6 disk, 130 interrupted");
  return [a, &common] {
    if (!a->maps.empty()) return evaluate_maps(*a, common);
    if (a->files.size() < 2)
      throw Error(ExitCode::usage, "expected MODEL ... RUN, or --maps FOLDER [MODEL ...] RUN");
    return evaluate_models(*a, common);
  };
}

}  // namespace echofuse::recon
