// SPDX-License-Identifier: MIT
// This is what a report says in sentences: how good, against what, and what fails.
#include <algorithm>
#include <cmath>
#include <sstream>

#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"

namespace echofuse::recon {
namespace {

std::string plus_minus(const Summaries& all, Metric metric) {
  const Summary& s = all[metric];
  const MetricWords& words = words_of(metric);
  return words.text(s.mean) +
         (!std::isnan(s.se) && s.maps > 4 ? " \u00b1 " + words.text(s.se) : "") + words.unit;
}

// One with IoU 0 draws nobody: no opponent.
std::string against_baselines(const Report& report) {
  const ScoredRow* best = nullptr;
  const auto iou = [](const ScoredRow& row) { return row.metrics[metric_iou].mean; };
  for (const ScoredRow& row : report.baselines)
    if (iou(row) > 0.01 && (best == nullptr || iou(row) > iou(*best))) best = &row;
  if (best == nullptr) return "none of the baselines scored here draws a body";
  return std::string("the best baseline that draws a body, ") + baseline_title(best->name) + ": " +
         plus_minus(best->metrics, metric_iou);
}

constexpr Metric judged[] = {metric_iou, metric_lateral_m, metric_depth_mae_m, metric_rmse_m,
                             metric_ssim_hard};

// In which metrics the other one is better, beyond chance.
std::string worse_than(const ModeResult& own, const ModeResult& other) {
  const Evaluation &a = own.evaluations.front(), &b = other.evaluations.front();
  if (a.rows != b.rows) return {};
  std::string out;
  for (const PairedDifference& d : paired_differences(a.scores, b.scores))
    if (std::ranges::count(judged, d.metric) > 0 && d.low > 0) {
      const MetricWords& words = words_of(d.metric);
      out += std::string(out.empty() ? "" : ", ") + words.name + " (" + words.text(d.first) +
             " against " + words.text(d.second) + words.unit + ")";
    }
  return out;
}

std::string of_models(const Report& report) {
  const ModeResult& subject = report.modes.front();
  const Summaries& own = subject.metrics;
  std::string out =
      title_of(subject) + formatted(", on %zu %s records%s: ", report.records,
                                    report.simulated ? "simulated" : "recorded",
                                    report.new_run ? " of a new run" : " that training held out");
  out += "IoU " + plus_minus(own, metric_iou);
  out += " (";
  for (const ModeResult& mode : report.modes)
    if (&mode != &subject && mode.takes == subject.takes)
      out +=
          short_name(mode) + ", of the same inputs: " + plus_minus(mode.metrics, metric_iou) + "; ";
  out += against_baselines(report) + ")";
  for (const Metric metric : {metric_lateral_m, metric_depth_mae_m})
    if (!std::isnan(own[metric].mean))
      out += std::string(", ") + words_of(metric).name + " " + plus_minus(own, metric);
  out += ".";
  for (const ModeResult& mode : report.modes)
    if (&mode != &subject)
      if (const std::string worse = worse_than(subject, mode); !worse.empty())
        out += " Worse than " + title_of(mode) + " in " + worse + ".";
  return out;
}

// Of the records whose body is farther off than stated it is the one that is so most.
std::string worst_interval(const Report& report) {
  const ModeResult& subject = report.modes.front();
  const Evaluation& e = subject.evaluations.front();
  std::size_t worst = e.scores.size();
  double most = 1;
  for (std::size_t i = 0; i < e.uncertainties.size(); ++i) {
    const double ratio = e.scores[i][metric_lateral_m] / e.uncertainties[i].lateral_interval_90_m;
    if (ratio > most) most = ratio, worst = i;
  }
  if (worst == e.scores.size()) return {};
  return formatted("Record %lld is %.0f cm off to the side; stated was: within %.0f cm (90 %%).",
                   static_cast<long long>(subject.records[worst].index),
                   100 * e.scores[worst][metric_lateral_m],
                   100 * e.uncertainties[worst].lateral_interval_90_m);
}

void add_run(std::vector<Problem>& out, const Evaluation& e, const std::string& where, bool live) {
  if (e.domain_shift.found()) out.push_back({where + e.domain_shift.text() + ".", live});
  if (const CountOf kept = kept_intervals(e); kept.of > 0 && kept.interval().second < 0.9)
    out.push_back({where + formatted("the body is within the stated interval in only %s records; "
                                     "it is stated for 90 %% (%.0f).",
                                     kept.text().c_str(), 0.9 * static_cast<double>(kept.of)),
                   live});
  for (const auto& [note, records] : e.fallbacks)
    out.push_back({where + formatted("%zu records: %s.", records, note.c_str()), live});
  if (e.left_out > 0)
    out.push_back({where + formatted("%zu records with depth left out: a sensor missing or dead.",
                                     e.left_out),
                   live});
}

}  // namespace

std::string CountOf::text() const { return formatted("%zu of %zu", count, of); }

std::pair<double, double> CountOf::interval() const {
  if (of == 0) return {0, 1};
  constexpr double z = 1.96;
  const auto n = static_cast<double>(of);
  const double p = static_cast<double>(count) / n, whole = 1 + z * z / n;
  const double middle = (p + z * z / (2 * n)) / whole;
  const double half = z / whole * std::sqrt(p * (1 - p) / n + z * z / (4 * n * n));
  return {std::max(0.0, middle - half), std::min(1.0, middle + half)};
}

CountOf count_of(const std::vector<MapScores>& scores, Metric metric) {
  CountOf out;
  for (const MapScores& s : scores)
    if (!std::isnan(s[metric])) ++out.of, out.count += s[metric] > 0.5;
  return out;
}

CountOf kept_intervals(const Evaluation& e) {
  CountOf out;
  for (std::size_t i = 0; i < e.uncertainties.size(); ++i) {
    const double stated = e.uncertainties[i].lateral_interval_90_m;
    const double error = e.scores[i][metric_lateral_m];
    if (!std::isnan(stated) && !std::isnan(error)) ++out.of, out.count += error <= stated;
  }
  return out;
}

std::string verdict(const Report& report) {
  if (report.modes.empty())
    return std::string(report.simulated ? "The simulated run is " : "The run is ") +
           verdict_of(*report.story);
  if (report.differences.empty()) return of_models(report);
  const PairedDifference& d = report.differences.front();
  const bool open = d.low <= 0 && d.high >= 0;
  return formatted(
      "On %zu %s records %s: IoU %.3f and %.3f, difference %+.3f (95 %%: %+.3f to %+.3f).",
      d.records, report.simulated ? "simulated" : "recorded",
      open         ? "the two models cannot be told apart"
      : d.mean > 0 ? "the second model is better"
                   : "the first model is better",
      d.first, d.second, d.mean, d.low, d.high);
}

std::vector<Problem> problems_of(const Report& report) {
  std::vector<Problem> out;
  if (report.live) add_run(out, *report.live, "Recorded run: ", true);
  if (report.story)
    for (const std::string& text : gone_sensors(*report.story))
      out.push_back({"Recorded run: " + text, true});
  if (report.live && report.story && report.window_s > 0 &&
      report.story->info.window_s != report.window_s)
    out.push_back(
        {formatted("Recorded run: its records are %g s long, those of the scored run %g s.",
                   report.story->info.window_s, report.window_s),
         true});
  if (report.modes.empty()) return out;
  const Evaluation& e = report.modes.front().evaluations.front();
  add_run(out, e, "", false);
  if (const std::string worst = worst_interval(report); !worst.empty())
    out.push_back({worst, false});
  return out;
}

std::vector<std::string> remarks_of(const Evaluation& e) {
  std::vector<std::string> out;
  if (e.domain_shift.tested() && !e.domain_shift.found()) out.push_back(e.domain_shift.text());
  if (!e.antennas.empty()) out.push_back(e.antennas);
  if (!e.response.empty()) out.push_back(e.response);
  return out;
}

}  // namespace echofuse::recon
