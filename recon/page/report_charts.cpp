// SPDX-License-Identifier: MIT
// The charts of a report.
#include <algorithm>
#include <cmath>

#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t group_records = 10, least_groups = 4, most_groups = 8;

double median_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// Medians of groups of as many records each, in the order of x; none of too few.
Pairs medians_of(const Pairs& values) {
  const std::size_t groups = std::min(values.size() / group_records, most_groups);
  Pairs out;
  if (groups < least_groups) return out;
  for (std::size_t g = 0; g < groups; ++g) {
    std::vector<double> x, y;
    for (std::size_t i = g * values.size() / groups; i < (g + 1) * values.size() / groups; ++i)
      x.push_back(values[i].first), y.push_back(values[i].second);
    out.emplace_back(median_of(x), median_of(y));
  }
  return out;
}

Pairs lateral_errors(const ModeResult& mode, double RecordFacts::*place) {
  const Evaluation& e = mode.evaluations.front();
  Pairs out;
  for (std::size_t i = 0; i < e.scores.size(); ++i)
    if (const double x = mode.records[i].*place, y = 100 * e.scores[i][metric_lateral_m];
        !std::isnan(x) && !std::isnan(y))
      out.emplace_back(x, y);
  std::sort(out.begin(), out.end());
  return out;
}

// The subject's records as dots, medians of all models.
Json error_chart(const Report& report, const std::string& title, const std::string& x,
                 double RecordFacts::*place) {
  Json out = chart(title, x, "lateral error (cm)");
  out["log"] = true;
  const Pairs own = lateral_errors(report.modes.front(), place);
  add_series(out, "a record", colour_of(report, 0), Look::dots, own);
  std::size_t groups = 0;
  for (std::size_t m = 0; m < report.modes.size(); ++m) {
    const Pairs medians = medians_of(lateral_errors(report.modes[m], place));
    groups = std::max(groups, medians.size());
    if (!medians.empty())
      add_series(out, short_name(report.modes[m]), colour_of(report, m), Look::marked, medians);
  }
  out["note"] =
      formatted("Dots: %zu records of %s. ", own.size(), title_of(report.modes.front()).c_str()) +
      (groups > 0 ? formatted("Lines: medians of %zu groups of about %zu records.", groups,
                              own.size() / groups)
                  : std::string("Too few for medians."));
  return out;
}

// It says which share of the records is below a value.
Json distribution(const Report& report, Metric metric, const std::string& title,
                  const std::string& x, double unit) {
  Json out = chart(title, x, "records below (%)");
  std::string numbers;
  for (std::size_t m = 0; m < report.modes.size(); ++m) {
    std::vector<double> values;
    for (const MapScores& s : report.modes[m].evaluations.front().scores)
      if (!std::isnan(s[metric])) values.push_back(unit * s[metric]);
    add_series(out, short_name(report.modes[m]), colour_of(report, m), Look::line,
               shares_below(values));
    numbers += (numbers.empty() ? "" : "; ") + short_name(report.modes[m]) + ": " +
               std::to_string(values.size()) + " records";
  }
  out["span"] = {0, 100}, out["note"] = numbers + ".";
  return out;
}

}  // namespace

Pairs shares_below(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t step = values.size() / 200 + 1;
  Pairs out;
  for (std::size_t i = 0; i < values.size(); i += step)
    out.emplace_back(values[i],
                     100.0 * static_cast<double>(i + 1) / static_cast<double>(values.size()));
  return out;
}

const char* colour_of(const Report& report, std::size_t mode) {
  const ModeResult& m = report.modes[mode];
  if (!report.differences.empty()) return mode == 0 ? "grey" : "both";
  constexpr const char* of_both[] = {"both", "papers", "depth", "grey"};
  const auto like = [&](const ModeResult& other) {
    return other.inputs == m.inputs || (both_sensors(other.inputs) && both_sensors(m.inputs));
  };
  const auto at = report.modes.begin() + static_cast<std::ptrdiff_t>(mode);
  const auto before = static_cast<std::size_t>(std::count_if(report.modes.begin(), at, like));
  if (both_sensors(m.inputs) || before > 0) return of_both[std::min<std::size_t>(before, 3)];
  return m.inputs == Inputs::spd ? "spd" : "radar";
}

Json errors(const Report& report) {
  Json lateral =
      distribution(report, metric_lateral_m, "Share of the records below a lateral error",
                   "lateral error (cm)", 100);
  lateral["log_x"] = true;
  return Json::array({charts(
      {error_chart(report, "Lateral error against range", "range (m)", &RecordFacts::range_m),
       error_chart(report, "Lateral error against side", "x, right of the SPD (m)",
                   &RecordFacts::side_m),
       lateral, distribution(report, metric_iou, "Share of the records below an IoU", "IoU", 1)})});
}

Json losses(const Report& report) {
  std::vector<Json> all;
  for (const ModeResult& mode : report.modes) {
    const TrainingLog& log = mode.models.front().log;
    if (log.loss.size() < 2) continue;
    Json out = chart(title_of(mode), "epoch", "loss (rms, unit of the model)");
    out["log"] = true;
    for (const bool validation : {false, true}) {
      Pairs points;
      for (const double value : validation ? log.validation_loss : log.loss)
        points.emplace_back(static_cast<double>(points.size() + 1), value);
      add_series(out, validation ? "validation" : "training", validation ? "both" : "grey",
                 Look::line, points);
    }
    if (log.best_epoch > 0) add_rule(out, static_cast<double>(log.best_epoch), "kept");
    all.push_back(out);
  }
  return all.empty() ? Json::array() : Json::array({charts(all)});
}

}  // namespace echofuse::recon
