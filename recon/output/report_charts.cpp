// SPDX-License-Identifier: MIT
// The charts of a report, and what they are drawn from.
#include <algorithm>
#include <cmath>
#include <map>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"
#include "recon/output/report_page.hpp"

namespace echofuse::recon {
namespace {

constexpr double panel_width = 560, panel_height = 320;

// Of the middle of a group of records: half of them above, half below.
struct Group {
  double at = 0, low = 0, middle = 0, high = 0;
};

double at_share(const std::vector<double>& sorted, double share) {
  return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
}

// Groups of as many records each, in the order of x.
std::vector<Group> groups_of(std::vector<std::pair<double, double>> values) {
  std::erase_if(values, [](const auto& v) { return std::isnan(v.first) || std::isnan(v.second); });
  std::sort(values.begin(), values.end());
  const std::size_t groups = std::clamp<std::size_t>(values.size() / 20, 1, 8);
  std::vector<Group> out;
  if (values.size() < 4) return out;
  for (std::size_t g = 0; g < groups; ++g) {
    const std::size_t first = g * values.size() / groups, last = (g + 1) * values.size() / groups;
    std::vector<double> x, y;
    for (std::size_t i = first; i < last; ++i)
      x.push_back(values[i].first), y.push_back(values[i].second);
    std::sort(y.begin(), y.end());
    out.push_back({at_share(x, 0.5), at_share(y, 0.25), at_share(y, 0.5), at_share(y, 0.75)});
  }
  return out;
}

// The subject with its quartiles, the others as lines.
chart::Panel error_panel(const Report& report, const std::string& title, const std::string& x,
                         double RecordFacts::*place) {
  chart::Panel panel{title, {x}, {"lateral error (cm)", true},
                     {},    {},  "Medians of groups of records; bars: quartiles."};
  panel.width = panel_width, panel.height = panel_height;
  for (std::size_t m = 0; m < report.modes.size(); ++m) {
    const ModeResult& mode = report.modes[m];
    const Evaluation& e = mode.evaluations.front();
    std::vector<std::pair<double, double>> values;
    for (std::size_t i = 0; i < e.scores.size(); ++i)
      values.emplace_back(mode.records[i].*place, 100 * e.scores[i][metric_lateral_m]);
    chart::Series line{title_of(mode), {}, static_cast<int>(std::min<std::size_t>(m, chart::grey))};
    for (const Group& g : groups_of(values)) {
      line.points.push_back({g.at, g.middle});
      if (m == 0) line.points.back().low = std::max(g.low, 0.05), line.points.back().high = g.high;
    }
    panel.series.push_back(line);
  }
  return panel;
}

// The error that so many of all records stay below.
chart::Panel distribution(const Report& report, Metric metric, const std::string& title,
                          const chart::Scale& y, double unit) {
  chart::Panel panel{title, {"share of the records (%)", false, 0, 100}, y, {}};
  panel.width = panel_width, panel.height = panel_height;
  for (std::size_t m = 0; m < report.modes.size(); ++m) {
    std::vector<double> values;
    for (const MapScores& s : report.modes[m].evaluations.front().scores)
      if (!std::isnan(s[metric])) values.push_back(unit * s[metric]);
    std::sort(values.begin(), values.end());
    chart::Series line{title_of(report.modes[m]),
                       {},
                       static_cast<int>(std::min<std::size_t>(m, chart::grey)),
                       chart::Look::line};
    for (int share = 2; share <= 98 && values.size() > 4; share += 2)
      line.points.push_back({double(share), at_share(values, share / 100.0)});
    panel.series.push_back(line);
  }
  return panel;
}

std::string summary(const Summary& s, double unit, const char* format) {
  if (std::isnan(s.mean)) return "-";
  std::string out = formatted(format, unit * s.mean);
  if (!std::isnan(s.se)) out += " <small>&plusmn;" + formatted(format, unit * s.se) + "</small>";
  return out;
}

const char* words_of(Metric metric) {
  switch (metric) {
    case metric_iou:
      return "IoU of the outline";
    case metric_lateral_m:
      return "lateral error (m)";
    case metric_depth_mae_m:
      return "depth error (m)";
    case metric_ssim_fg:
      return "SSIM near the body";
    case metric_ssim_hard:
      return "SSIM, hard map";
    case metric_rmse_m:
      return "RMSE (m)";
    default:
      return metric_names[metric];
  }
}

std::string some_records(const std::vector<std::int64_t>& indices) {
  constexpr std::size_t most = 8;
  std::string out;
  for (std::size_t i = 0; i < std::min(most, indices.size()); ++i)
    out += (i ? ", " : "") + std::to_string(indices[i]);
  return out + (indices.size() > most ? ", ..." : "");
}

struct Failure {
  std::string what;
  std::vector<std::int64_t> records;
};

std::vector<Failure> failures_of(const ModeResult& mode) {
  const Evaluation& e = mode.evaluations.front();
  std::vector<Failure> out{{"the outline is missed (IoU below 0.2)", {}},
                           {"the body stands on the wrong side", {}},
                           {"more than 30 cm off to the side", {}},
                           {"farther off than it states (90 % should be within)", {}}};
  std::map<std::string, std::vector<std::int64_t>> flags;
  for (std::size_t i = 0; i < e.scores.size(); ++i) {
    const MapScores& s = e.scores[i];
    const std::int64_t index = mode.records[i].index;
    if (s[metric_iou] < 0.2) out[0].records.push_back(index);
    if (s[metric_left_right] < 0.5) out[1].records.push_back(index);
    if (s[metric_lateral_m] > 0.3) out[2].records.push_back(index);
    if (i >= e.uncertainties.size()) continue;
    const PredictionUncertainty& u = e.uncertainties[i];
    if (s[metric_lateral_m] > u.lateral_interval_90_m) out[3].records.push_back(index);
    if (!u.out_of_distribution.reason.empty())
      flags["flagged as unlike the training: " + u.out_of_distribution.reason].push_back(index);
  }
  if (e.uncertainties.empty()) out.pop_back();
  for (auto& [what, records] : flags) out.push_back({what, std::move(records)});
  return out;
}

std::string stated_html(const Report& report) {
  std::vector<chart::TableRow> rows;
  const auto add = [&](const std::string& name, const Evaluation& e) {
    if (!e.calibration) {
      rows.push_back({{chart::escaped(name), "not calibrated", "", "", "", ""}});
      return;
    }
    const UncertaintyCalibration& c = *e.calibration;
    const auto cell = [](const char* form, double value) {
      return std::isnan(value) ? std::string("-") : formatted(form, value);
    };
    rows.push_back({{chart::escaped(name), cell("%.1f", 100 * c.lateral_interval_90_m),
                     cell("%.1f %%", 100 * c.within_90), cell("%.2f", c.deviation_m),
                     cell("%.2f", c.error_m), cell("%.1f %%", 100 * c.flagged)}});
  };
  for (const auto& mode : report.modes) add(title_of(mode), mode.evaluations.front());
  if (report.live) add("live run", *report.live);
  return chart::table("How sure the models are, and how that holds",
                      {"", "stated: within (cm, 90 %)", "records within it",
                       "stated uncertainty of a pixel (m, rms)", "error of the mean map (m, rms)",
                       "unlike the training"},
                      rows);
}

}  // namespace

std::string errors_html(const Report& report) {
  if (report.modes.empty()) return {};
  std::vector<std::string> drawings;
  for (const chart::Panel& panel :
       {error_panel(report, "Error against range", "range (m)", &RecordFacts::range_m),
        error_panel(report, "Error against side", "x, right of the detector (m)",
                    &RecordFacts::side_m),
        distribution(report, metric_lateral_m, "How many records stay below which lateral error",
                     {"lateral error (cm)", true}, 100),
        distribution(report, metric_iou, "How many records stay below which IoU",
                     {"IoU of the foreground", false, 0, 1}, 1)})
    drawings.push_back(chart::draw(panel).svg);
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
      chart::Series line{
          validation ? "validation" : "training", {}, validation ? 1 : 0, chart::Look::line};
      for (std::size_t i = 0; i < values.size(); ++i)
        line.points.push_back({static_cast<double>(i + 1), values[i]});
      panel.series.push_back(line);
    }
    panel.width = panel_width, panel.height = 260;
    if (log.best_epoch > 0) panel.rules = {{static_cast<double>(log.best_epoch), "kept", true}};
    drawings.push_back(chart::draw(panel).svg);
  }
  return drawings.empty() ? "" : chart::figure(drawings, "");
}

std::string failures_html(const Report& report) {
  if (report.modes.empty()) return {};
  const ModeResult& subject = report.modes.front();
  const auto all = static_cast<double>(subject.records.size());
  std::vector<chart::TableRow> rows;
  for (const Failure& f : failures_of(subject))
    rows.push_back({{chart::escaped(f.what), std::to_string(f.records.size()),
                     formatted("%.1f %%", 100 * static_cast<double>(f.records.size()) / all),
                     "<span class=\"words\">" +
                         (f.records.empty() ? "-" : some_records(f.records)) + "</span>"}});
  return chart::table(formatted("%s, %.0f records", title_of(subject).c_str(), all),
                      {"what", "records", "share", "which"}, rows) +
         stated_html(report);
}

std::string labels_html(const ModeResult& mode) {
  const Evaluation& e = mode.evaluations.front();
  std::map<std::string, std::vector<MapScores>> by_label;
  for (std::size_t i = 0; i < e.scores.size(); ++i)
    by_label[mode.records[i].label].push_back(e.scores[i]);
  if (by_label.size() < 2) return {};
  std::vector<chart::TableRow> rows;
  for (const auto& [label, scores] : by_label) {
    const Summaries s = summarise(scores);
    rows.push_back(
        {{label.empty() ? "(none)" : chart::escaped(label), std::to_string(scores.size()),
          summary(s[metric_iou], 1, "%.3f"), summary(s[metric_lateral_m], 100, "%.1f"),
          summary(s[metric_depth_mae_m], 100, "%.1f"), summary(s[metric_left_right], 100, "%.0f"),
          summary(s[metric_letter_top1], 100, "%.0f"),
          summary(s[metric_letter_top3], 100, "%.0f")}});
  }
  return chart::table("Mean and standard error, " + title_of(mode),
                      {"label", "records", "IoU", "lateral error (cm)", "depth error (cm)",
                       "right side (%)", "letter read (%)", "among three (%)"},
                      rows);
}

std::string comparison_html(const Report& report) {
  if (report.differences.empty()) return {};
  const std::string a = title_of(report.modes[0]), b = title_of(report.modes[1]);
  std::vector<chart::TableRow> rows;
  for (const PairedDifference& d : report.differences) {
    const bool less_is_better = d.metric == metric_lateral_m || d.metric == metric_depth_mae_m ||
                                d.metric == metric_rmse_m || d.metric == metric_ghost;
    const bool open = d.low <= 0 && d.high >= 0;
    const bool second = (d.mean > 0) != less_is_better;
    rows.push_back({{words_of(d.metric), std::to_string(d.records), formatted("%.4f", d.first),
                     formatted("%.4f", d.second), formatted("%+.4f", d.mean),
                     formatted("%+.4f to %+.4f", d.low, d.high),
                     open     ? "not told apart"
                     : second ? "<b class=\"good\">second</b>"
                              : "<b class=\"good\">first</b>"}});
  }
  std::vector<std::string> drawings;
  for (const auto& [metric, name, unit] :
       {std::tuple{metric_iou, "difference of IoU", 1.0},
        {metric_lateral_m, "difference of the lateral error (cm)", 100.0}}) {
    std::vector<double> values;
    for (const MapScores& s : report.paired)
      if (!std::isnan(s[metric])) values.push_back(unit * s[metric]);
    std::sort(values.begin(), values.end());
    chart::Panel panel{"Record by record, second minus first",
                       {"share of the records (%)", false, 0, 100},
                       {name},
                       {{"", {}, 0, chart::Look::line}},
                       {{0, "equal"}}};
    panel.width = panel_width, panel.height = panel_height;
    for (int share = 1; share <= 99 && values.size() > 1; ++share)
      panel.series[0].points.push_back({double(share), at_share(values, share / 100.0)});
    drawings.push_back(chart::draw(panel).svg);
  }
  return chart::paragraph("First: " + a + ". Second: " + b + ".") +
         chart::table(
             "Second minus first on the same records; intervals of 95 % by resampled blocks of ten "
             "neighbours",
             {"metric", "records", "first", "second", "difference", "95 % interval", "better"},
             rows) +
         chart::figure(drawings, "");
}

}  // namespace echofuse::recon
