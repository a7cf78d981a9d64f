// SPDX-License-Identifier: MIT
// The charts of a report, and what they are drawn from.
#include <algorithm>
#include <cmath>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"
#include "recon/output/report_page.hpp"

namespace echofuse::recon {
namespace {

constexpr double panel_width = 560, panel_height = 320;
constexpr std::size_t group_records = 10, least_groups = 4, most_groups = 8;

using Pairs = std::vector<std::pair<double, double>>;

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
chart::Panel error_panel(const Report& report, const std::string& title, const std::string& x,
                         double RecordFacts::*place) {
  chart::Panel panel{title, {x}, {"lateral error (cm)", true}, {}};
  panel.width = panel_width, panel.height = panel_height + 20;
  const Pairs own = lateral_errors(report.modes.front(), place);
  chart::Series dots{"", {}, colour_of(report, 0), chart::Look::cloud};
  for (const auto& [at, error] : own) dots.points.push_back({at, error});
  panel.series.push_back(dots);
  std::size_t groups = 0;
  for (std::size_t m = 0; m < report.modes.size(); ++m) {
    chart::Series line{name_for_charts(report.modes[m]), {}, colour_of(report, m)};
    for (const auto& [at, error] : medians_of(lateral_errors(report.modes[m], place)))
      line.points.push_back({at, error});
    groups = std::max(groups, line.points.size());
    if (!line.points.empty()) panel.series.push_back(line);
  }
  panel.note =
      formatted("Dots: %zu records of %s. ", own.size(), title_of(report.modes.front()).c_str());
  panel.note += groups > 0 ? formatted("Lines: medians of %zu groups of about %zu records.", groups,
                                       own.size() / groups)
                           : std::string("Too few for medians.");
  return panel;
}

// Which share of the records is below a value.
chart::Panel distribution(const Report& report, Metric metric, const std::string& title,
                          const chart::Scale& x, double unit) {
  chart::Panel panel{title, x, {"records below (%)", false, 0, 100}, {}};
  panel.width = panel_width, panel.height = panel_height + 20;
  std::string numbers;
  for (std::size_t m = 0; m < report.modes.size(); ++m) {
    std::vector<double> values;
    for (const MapScores& s : report.modes[m].evaluations.front().scores)
      if (!std::isnan(s[metric])) values.push_back(unit * s[metric]);
    std::sort(values.begin(), values.end());
    chart::Series line{
        name_for_charts(report.modes[m]), {}, colour_of(report, m), chart::Look::line};
    line.marked = 6;
    const std::size_t step = values.size() / 200 + 1;
    for (std::size_t i = 0; i < values.size(); i += step)
      line.points.push_back(
          {values[i], 100.0 * static_cast<double>(i + 1) / static_cast<double>(values.size())});
    panel.series.push_back(line);
    numbers += (numbers.empty() ? "" : "; ") + name_for_charts(report.modes[m]) + ": " +
               std::to_string(values.size()) + " records";
  }
  panel.note = numbers + ".";
  return panel;
}

}  // namespace

int colour_of(const Report& report, std::size_t mode) {
  const ModeResult& m = report.modes[mode];
  if (!report.differences.empty()) return mode == 0 ? chart::of_both : chart::grey;
  if (m.name == "paper") return chart::of_paper;
  return both_sensors(m.inputs)    ? chart::of_both
         : m.inputs == Inputs::spd ? chart::of_spd
                                   : chart::of_radar;
}

std::string errors_html(const Report& report) {
  if (report.modes.empty()) return {};
  std::vector<std::string> drawings;
  for (const chart::Panel& panel :
       {error_panel(report, "Lateral error against range", "range (m)", &RecordFacts::range_m),
        error_panel(report, "Lateral error against side", "x, right of the SPD (m)",
                    &RecordFacts::side_m),
        distribution(report, metric_lateral_m, "Share of the records below a lateral error",
                     {"lateral error (cm)", true}, 100),
        distribution(report, metric_iou, "Share of the records below an IoU", {"IoU", false, 0, 1},
                     1)})
    drawings.push_back(chart::for_both_widths(panel));
  return chart::figure(drawings, "");
}

std::string losses_html(const Report& report) {
  std::vector<std::string> drawings;
  for (const ModeResult& mode : report.modes) {
    const TrainingLog& log = mode.models.front().log;
    if (log.loss.size() < 2) continue;
    chart::Panel panel{title_of(mode), {"epoch"}, {"loss (rms, unit of the model)", true}, {}};
    for (const bool validation : {false, true}) {
      const auto& values = validation ? log.validation_loss : log.loss;
      chart::Series line{validation ? "validation" : "training",
                         {},
                         validation ? chart::of_both : chart::grey,
                         chart::Look::line,
                         validation};
      for (std::size_t i = 0; i < values.size(); ++i)
        line.points.push_back({static_cast<double>(i + 1), values[i]});
      panel.series.push_back(line);
    }
    panel.width = panel_width, panel.height = 260;
    if (log.best_epoch > 0) panel.rules = {{static_cast<double>(log.best_epoch), "kept", true}};
    drawings.push_back(chart::for_both_widths(panel));
  }
  return drawings.empty() ? "" : chart::figure(drawings, "");
}

}  // namespace echofuse::recon
