// SPDX-License-Identifier: MIT
// `rows`: lists the training, validation and test records, and the reasons for excluding others.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/cli/commands.hpp"
#include "recon/cli/train_settings.hpp"
#include "recon/score/evaluate.hpp"
#include "recon/train/crossvalidate.hpp"
#include "recon/train/train.hpp"

namespace echofuse::recon {
namespace {

constexpr std::array parts{"train", "validation", "test"};  // names in the order of enum Subset

struct Arguments : TrainOptions {
  std::vector<std::string> runs, assignments;
  std::string model_file;
  bool json = false;
};

// A record of a run, and the part of the split to which it belongs (training, validation or test)
// or the reason why it is excluded.
struct ListedRow {
  std::string run;
  std::int64_t index = 0;
  std::string part, left_out;
};

std::vector<ListedRow> rows_of_training(const Dataset& data, const Arguments& a) {
  const TrainingRows usable = rows_to_train(data, inputs_to_train(a));
  const Split split = make_split(usable.rows, a.split);
  std::vector<ListedRow> out;
  for (std::size_t row = 0; row < data.size(); ++row)
    out.push_back(
        {data.sources[data.source_of(row)].path, data.records[row].index, "", usable.reasons[row]});
  for (const auto& [part, rows] : {std::pair{Subset::train, &split.train},
                                   {Subset::validation, &split.validation},
                                   {Subset::test, &split.test}})
    for (const std::size_t row : *rows) out[row].part = parts[static_cast<std::size_t>(part)];
  for (ListedRow& row : out)
    if (row.part.empty() && row.left_out.empty())
      row.left_out = "in the gap between the parts of the split";
  return out;
}

std::vector<ListedRow> rows_of_model(const std::string& path, const Dataset& recorded) {
  const TrainedModel model = load_model(path);
  const Records records = prepare_records(model, recorded);
  const Dataset& data = records.data;
  const std::vector<std::string> left_out = left_out_of_evaluation(model, data, false);
  std::vector<ListedRow> out;
  for (std::size_t row = 0; row < data.size(); ++row)
    out.push_back({data.sources[data.source_of(row)].path, data.records[row].index,
                   left_out[row].empty() ? "test" : "", left_out[row]});
  for (const Subset part : {Subset::train, Subset::validation})
    for (const std::size_t row : model.rows_of(data, part))
      out[row].part = parts[static_cast<std::size_t>(part)], out[row].left_out.clear();
  return out;
}

std::string summary(const std::vector<ListedRow>& rows) {
  std::map<std::string, std::size_t> in_part, reasons;
  for (const ListedRow& row : rows)
    ++(row.left_out.empty() ? in_part[row.part] : reasons[row.left_out]);
  std::string out = format("%zu records", rows.size()), separator = ": ";
  for (const char* part : parts)
    if (in_part[part] > 0)
      out += separator + format("%zu %s", in_part[part], part), separator = ", ";
  separator = "; left out: ";
  for (const auto& [why, count] : reasons)
    out += separator + format("%s %zu", why.c_str(), count), separator = ", ";
  return out;
}

void list(const std::vector<ListedRow>& rows, bool several_runs) {
  std::string text;
  for (const ListedRow& row : rows)
    text += (several_runs ? printable(row.run) + " " : "") +
            format("%lld ", static_cast<long long>(row.index)) +
            (row.left_out.empty() ? row.part : "left out: " + printable(row.left_out)) + '\n';
  std::fputs(text.c_str(), stdout);
}

void list_json(const std::vector<ListedRow>& rows) {
  auto out = nlohmann::json::array();
  for (const ListedRow& row : rows) {
    nlohmann::json one = {{"run", row.run}, {"record", row.index}};
    row.left_out.empty() ? one["part"] = row.part : one["left_out"] = row.left_out;
    out.push_back(std::move(one));
  }
  std::puts(nlohmann::json{{"schema", 1}, {"records", out}}
                .dump(-1, ' ', true, nlohmann::json::error_handler_t::replace)
                .c_str());
}

}  // namespace

Command add_rows(CLI::App& app, const Common& common) {
  const auto a = std::make_shared<Arguments>();
  app.add_option("run", a->runs, "run files, in the order in which they are given to `train`")
      ->type_name("RUN")
      ->required();
  app.add_option("--model", a->model_file,
                 "list the records on which this model was trained, and the records on which "
                 "`evaluate` scores this model")
      ->type_name("MODEL");
  add_split_options(app, *a, a->assignments);
  app.add_flag("--json", a->json, "print JSON instead of text");
  more_options(app, {"--inputs", "--seed", "--set"});
  add_examples(app,
               {"echofuse-recon rows monday.sqlite",
                "echofuse-recon rows monday.sqlite --model fused.safetensors --json"},
               "3 config, 130 interrupted");
  return [a, &app, &common] {
    TrainSettings settings(*a);
    take(a->assignments, settings);
    a->split.seed = a->fit.seed;
    if (!a->model_file.empty())
      for (const char* option : {"--inputs", "--seed", "--split", "--set"})
        if (app.get_option(option)->count() > 0)
          throw Error(ExitCode::usage,
                      std::string(option) +
                          " cannot be combined with --model, because the model defines the split");
    Dataset data = load_recorded(a->runs);
    apply_doubts(data, *a);
    a->model = usual_model(shows_sides(data, inputs_of(a->inputs)));
    std::vector<ListedRow> rows =
        a->model_file.empty() ? rows_of_training(data, *a) : rows_of_model(a->model_file, data);
    for (const DamagedRecord& damaged : data.damaged)
      rows.push_back({damaged.path, damaged.index, "", "damaged"});
    std::ranges::stable_sort(rows, {}, [&](const ListedRow& row) {
      const auto run = std::ranges::find(data.sources, row.run, &Source::path);
      return std::pair(run - data.sources.begin(), row.index);
    });
    a->json ? list_json(rows) : list(rows, a->runs.size() > 1);
    if (!common.quiet) std::fprintf(stderr, "%s\n", printable(summary(rows)).c_str());
    return ExitCode::ok;
  };
}

}  // namespace echofuse::recon
