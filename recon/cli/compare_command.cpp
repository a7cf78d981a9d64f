// SPDX-License-Identifier: MIT
// `compare`: prints confidence intervals and paired differences of the scores in a CSV table.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "drivers/util/command_line.hpp"
#include "drivers/util/console.hpp"
#include "drivers/util/format.hpp"
#include "drivers/util/printable.hpp"
#include "recon/cli/commands.hpp"
#include "recon/score/paired.hpp"

namespace echofuse::recon {
namespace {

constexpr std::array shown{metric_iou, metric_lateral_m, metric_depth_mae_m};

std::vector<MapScores> all_of(const NamedScores& one) {
  std::vector<MapScores> out;
  for (const auto& [index, scores] : one.of_record) out.push_back(scores);
  return out;
}

// Returns the gains of method `one` over method `first`, averaged over the records with scores for
// both methods.
std::vector<PairedDifference> differences_of(const NamedScores& first, const NamedScores& one) {
  std::vector<MapScores> a, b;
  for (const auto& [index, scores] : one.of_record)
    if (const auto at = first.of_record.find(index); at != first.of_record.end())
      a.push_back(at->second), b.push_back(scores);
  return paired_differences(a, b);
}

nlohmann::json json_of(const std::vector<NamedScores>& all) {
  auto out = nlohmann::json::array();
  for (const NamedScores& one : all) {
    auto metrics = nlohmann::json::object();
    const std::vector<MapScores> scores = all_of(one);
    for (const Metric m : shown) {
      const MeanInterval i = mean_interval(scores, m);
      metrics[metric_names[m]] = {
          {"records", i.records}, {"mean", i.mean}, {"low", i.low}, {"high", i.high}};
    }
    out.push_back({{"name", one.name},
                   {"records", one.of_record.size()},
                   {"metrics", metrics},
                   {"difference", to_json(&one == &all[0] ? std::vector<PairedDifference>{}
                                                          : differences_of(all[0], one))}});
  }
  return {{"schema", 1}, {"methods", out}};
}

std::string interval_text(const MeanInterval& i) {
  return std::isnan(i.low) ? format("%.4f (too few records for an interval)", i.mean)
                           : format("%.4f (95 %%: %.4f to %.4f)", i.mean, i.low, i.high);
}

std::string text_of(const std::vector<NamedScores>& all) {
  std::string out;
  for (const NamedScores& one : all) {
    const std::vector<MapScores> scores = all_of(one);
    for (const Metric m : shown)
      if (const MeanInterval i = mean_interval(scores, m); i.records > 0)
        out += format("%s: %s %s, %zu records\n", one.name.c_str(), metric_names[m],
                      interval_text(i).c_str(), i.records);
    if (&one == &all[0]) continue;
    for (const PairedDifference& d : differences_of(all[0], one))
      if (d.metric == metric_iou || d.metric == metric_lateral_m)
        out += format("%s vs %s: %s better by %s\n", one.name.c_str(), all[0].name.c_str(),
                      metric_names[d.metric], interval_text(d).c_str());
  }
  return out;
}

}  // namespace

Command add_compare(CLI::App& app, const Common&) {
  struct Arguments {
    std::string table;
    bool json = false;
  };
  const auto a = std::make_shared<Arguments>();
  app.add_option("table", a->table,
                 "CSV table written by `evaluate --per-record`; every further model is compared "
                 "with the first model")
      ->type_name("TABLE")
      ->required();
  app.add_flag("--json", a->json, "print JSON instead of text");
  add_examples(app, {"echofuse-recon evaluate --maps mine --maps yours fresh.sqlite --per-record "
                     "records.csv",
                     "echofuse-recon compare records.csv"});
  return [a] {
    const std::vector<NamedScores> all = read_scores(a->table);
    if (all.empty()) throw Error(ExitCode::failed, a->table + ": has no records");
    if (a->json)
      std::puts(json_of(all).dump(2, ' ', true, nlohmann::json::error_handler_t::replace).c_str());
    else
      print(printable_lines(text_of(all)));
    return ExitCode::ok;
  };
}

}  // namespace echofuse::recon
