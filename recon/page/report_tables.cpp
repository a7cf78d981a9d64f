// SPDX-License-Identifier: MIT
// The tables of a report.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <span>

#include "recon/numbers/statistics.hpp"
#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"

namespace echofuse::recon {
namespace {

constexpr MetricWords metric_words[] = {
    {metric_iou, "IoU", "", 1, 2, Best::more},
    {metric_lateral_m, "lateral error", " cm", 100, 1, Best::less},
    {metric_depth_mae_m, "depth error", " cm", 100, 1, Best::less},
    {metric_ghost, "ghost", "", 1, 2, Best::zero},
    {metric_left_right, "on the true side", "", 1, 2, Best::more},
    {metric_rmse_m, "RMSE", " m", 1, 2, Best::less},
    {metric_ssim, "SSIM", "", 1, 2, Best::more},
    {metric_ssim_hard, "SSIM, hard map", "", 1, 2, Best::more},
    {metric_ssim_fg, "SSIM near the body", "", 1, 2, Best::more},
};
constexpr std::size_t of_first_screen = 3;

struct NamedScores {
  std::string name;
  const Summaries* metrics;
  bool baseline;
  const Evaluation* evaluation = nullptr;  // of a single model: can be paired
};

std::vector<NamedScores> scored(const Report& report) {
  std::vector<NamedScores> out;
  for (const auto& mode : report.modes)
    out.push_back({title_of(mode), &mode.metrics, false,
                   mode.evaluations.size() == 1 ? &mode.evaluations.front() : nullptr});
  for (const auto& row : report.baselines)
    out.push_back({baseline_title(row.name), &row.metrics, true});
  return out;
}

// Less is better.
double loss(const MetricWords& c, double value) {
  return c.best == Best::more ? -value : c.best == Best::zero ? std::abs(value) : value;
}

bool same(const NamedScores& a, const NamedScores& b, const MetricWords& c) {
  const Summary &x = (*a.metrics)[c.metric], &y = (*b.metrics)[c.metric];
  const double apart = std::abs(loss(c, x.mean) - loss(c, y.mean));
  if (a.evaluation && b.evaluation && a.evaluation->rows == b.evaluation->rows) {
    std::vector<double> differences;  // record by record
    for (std::size_t i = 0; i < a.evaluation->scores.size(); ++i)
      if (const double d = a.evaluation->scores[i][c.metric] - b.evaluation->scores[i][c.metric];
          !std::isnan(d))
        differences.push_back(d);
    const auto n = static_cast<double>(differences.size());
    if (n > 4) return apart <= 1.96 * standard_deviation(differences) / std::sqrt(n - 1);
  }
  const auto square = [](double se) { return std::isnan(se) ? 0 : se * se; };
  return apart <= 1.96 * std::sqrt(square(x.se) + square(y.se));
}

// The best and all that cannot be told apart from it.
std::vector<bool> best_of(const std::vector<NamedScores>& rows, const MetricWords& c) {
  std::vector<bool> out(rows.size());
  std::size_t best = rows.size();
  const auto mean = [&](std::size_t i) { return (*rows[i].metrics)[c.metric].mean; };
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (!std::isnan(mean(i)) && (best == rows.size() || loss(c, mean(i)) < loss(c, mean(best))))
      best = i;
  for (std::size_t i = 0; i < rows.size(); ++i)
    out[i] = best < rows.size() && !std::isnan(mean(i)) && same(rows[i], rows[best], c);
  return out;
}

Json value(const NamedScores& row, const MetricWords& c, bool best) {
  const Summary& s = (*row.metrics)[c.metric];
  if (std::isnan(s.mean))
    return cell("", c.metric == metric_depth_mae_m || c.metric == metric_lateral_m ? "no body found"
                                                                                   : "not defined");
  std::string mean = std::abs(s.mean) < 1e-14 ? "0" : c.text(s.mean), error;
  if (c.metric == metric_left_right && (row.baseline || row.evaluation))
    mean = formatted("%.0f of %zu", s.mean * static_cast<double>(s.maps), s.maps);
  else if (!std::isnan(s.se) && s.maps > 2 && s.se > 0)
    error = "\u00b1" + c.text(s.se);
  return cell(mean, error, best ? "best" : "");
}

Json head_of(const MetricWords& c) {
  return cell(c.title(), c.best == Best::more   ? "more is better"
                         : c.best == Best::less ? "less is better"
                                                : "0 is best");
}

Json table_of(const std::vector<NamedScores>& rows, const std::string& caption) {
  Json head{"model"}, out = Json::array();
  std::size_t baselines = 0;
  for (const NamedScores& row : rows)
    out.push_back(Json::array({row.name})), baselines += row.baseline;
  for (const MetricWords& c : std::span(metric_words).first(of_first_screen)) {
    head.push_back(head_of(c));
    const auto best = best_of(rows, c);
    for (std::size_t i = 0; i < rows.size(); ++i) out[i].push_back(value(rows[i], c, best[i]));
  }
  return Json::array({table(caption, head, out, baselines)});
}

// It is of the subject; the others' follow from it.
std::string n_of_depth(const NamedScores& row) {
  const Summary& depth = (*row.metrics)[metric_depth_mae_m];
  return row.evaluation
             ? formatted("; depth error over the %zu maps in which body meets body", depth.maps)
             : "";
}

Json summary(const Summaries& all, Metric metric, int more_decimals = 0) {
  const Summary& s = all[metric];
  const MetricWords& words = words_of(metric);
  if (std::isnan(s.mean)) return "\u2013";
  return cell(words.text(s.mean, more_decimals),
              !std::isnan(s.se) && s.maps > 4 ? "\u00b1" + words.text(s.se, more_decimals) : "");
}

std::string counted(const std::vector<MapScores>& scores, Metric metric) {
  const CountOf out = count_of(scores, metric);
  return out.of > 0 ? out.text() : "\u2013";
}

}  // namespace

std::string MetricWords::title() const {
  return *unit == 0 ? name : std::string(name) + " (" + (unit + 1) + ")";
}
std::string MetricWords::text(double value, int more_decimals) const {
  return formatted("%.*f", decimals + more_decimals, scale * value);
}

const MetricWords& words_of(Metric metric) {
  return *std::ranges::find(metric_words, metric, &MetricWords::metric);
}

Json first_table(const Report& report) {
  const auto rows = scored(report);
  const std::size_t seeds = report.modes.front().evaluations.size();
  return table_of(rows,
                  formatted("%zu records; mean \u00b1 standard error over %s%s; best: and all "
                            "that cannot be told apart from it",
                            report.records, seeds > 1 ? "trainings" : "maps",
                            n_of_depth(rows.front()).c_str()));
}

Json live_table(const Report& report) {
  std::vector<NamedScores> rows{
      {title_of(report.modes.front()), &report.live->metrics, false, &*report.live}};
  for (const auto& row : report.live->baselines)
    rows.push_back({baseline_title(row.name), &row.metrics, true});
  return table_of(rows, formatted("%zu records of the recorded run against its depth camera",
                                  report.live->records));
}

// Metrics down, models across: it fits beside seven.
Json all_table(const Report& report) {
  const auto rows = scored(report);
  Json head{"metric"}, out = Json::array();
  for (const NamedScores& row : rows) head.push_back(row.name);
  for (const MetricWords& c : metric_words) {
    const auto best = best_of(rows, c);
    Json line = Json::array({head_of(c)});
    for (std::size_t i = 0; i < rows.size(); ++i) line.push_back(value(rows[i], c, best[i]));
    out.push_back(line);
  }
  return Json::array({table("Best: and all that cannot be told apart from it", head, out)});
}

double paper_ssim(const ModeResult& mode) {
  if (mode.models.empty() || !mode.models.front().papers) return 0;
  return mode.inputs == Inputs::spd ? 0.6389 : mode.inputs == Inputs::radar ? 0.5266 : 0.6576;
}

Json beside_paper(const Report& report) {
  Json rows = Json::array();
  for (const ModeResult& mode : report.modes)
    if (const double paper = paper_ssim(mode); paper > 0)
      rows.push_back(
          {title_of(mode), summary(mode.metrics, metric_ssim, 1), formatted("%.4f", paper)});
  if (rows.empty()) return rows;
  return Json::array(
      {table("Beside the paper: its networks only (Lai et al., Chin. Opt. Lett. 22, 022701, 2024)",
             {"", "SSIM here", "SSIM in the paper"}, rows),
       paragraph("The paper states neither window nor data range of its SSIM, so its values cannot "
                 "be met as absolutes" +
                 std::string(rows.size() > 1 ? "; what can be compared is the gap between both "
                                               "sensors and either one alone."
                                             : "."))});
}

Json cost_table(const Report& report) {
  Json rows = Json::array();
  for (const auto& mode : report.modes) {
    const RunningCost& c = mode.evaluations.front().cost;
    rows.push_back({title_of(mode), formatted("%.0f", c.infer_us_median),
                    formatted("%.0f", c.infer_us_p99),
                    three_digits(static_cast<double>(c.cost.multiply_adds)),
                    three_digits(static_cast<double>(c.cost.parameters)),
                    formatted("%.1f", static_cast<double>(c.model_bytes) / 1e6),
                    formatted("%.0f", c.train_s)});
  }
  return Json::array(
      {table("One map on one thread of this host",
             {"", "time of a map (\u00b5s, median)", "99 % are below (\u00b5s)", "multiply-adds",
              "parameters", cell("file (MB)", "with fallbacks and what it knows of its errors"),
              "training (s)"},
             rows)});
}

Json labels_table(const ModeResult& mode) {
  const Evaluation& e = mode.evaluations.front();
  std::map<std::string, std::vector<MapScores>> by_label;
  for (std::size_t i = 0; i < e.scores.size(); ++i)
    by_label[mode.records[i].label].push_back(e.scores[i]);
  Json rows = Json::array();
  if (by_label.size() < 2) return rows;
  for (const auto& [label, scores] : by_label) {
    const Summaries s = summarise(scores);
    rows.push_back({label.empty() ? "(none)" : label, std::to_string(scores.size()),
                    summary(s, metric_iou), summary(s, metric_lateral_m),
                    summary(s, metric_depth_mae_m), counted(scores, metric_left_right)});
  }
  return Json::array({table(
      "Means, of five records and more \u00b1 standard error; " + title_of(mode),
      {"label", "records", "IoU", "lateral error (cm)", "depth error (cm)", "on the true side"},
      rows)});
}

}  // namespace echofuse::recon
