// SPDX-License-Identifier: MIT
// The page and the text of a report.
#include "recon/output/report_page.hpp"

#include <array>
#include <cmath>
#include <sstream>

#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/core/console.hpp"
#include "recon/files/text.hpp"

namespace echofuse::recon {
namespace {

struct Column {
  Metric metric;
  const char *title, *format;
  double unit;
  bool less_is_better;
};
// Of the first screen.
constexpr Column first_columns[] = {
    {metric_iou, "IoU of the outline", "%.3f", 1, false},
    {metric_lateral_m, "lateral error (cm)", "%.1f", 100, true},
    {metric_depth_mae_m, "depth error (cm)", "%.1f", 100, true},
};
constexpr Column all_columns[] = {
    {metric_iou, "IoU", "%.3f", 1, false},
    {metric_lateral_m, "lateral error (m)", "%.3f", 1, true},
    {metric_depth_mae_m, "depth error where both show a body (m)", "%.3f", 1, true},
    {metric_ghost, "ghost", "%.3f", 1, true},
    {metric_left_right, "on the right side", "%.3f", 1, false},
    {metric_rmse_m, "RMSE (m)", "%.3f", 1, true},
    {metric_ssim, "SSIM", "%.3f", 1, false},
    {metric_ssim_hard, "SSIM, hard map", "%.3f", 1, false},
    {metric_ssim_fg, "SSIM near the body", "%.3f", 1, false},
};

struct NamedScores {
  std::string name;
  const Summaries* metrics;
  bool baseline;
};

const char* baseline_title(const std::string& name) {
  if (name == "empty") return "empty room";
  if (name == "mean") return "mean map";
  return "nearest training record";
}

std::vector<NamedScores> scored(const Report& report) {
  std::vector<NamedScores> out;
  for (const auto& mode : report.modes) out.push_back({title_of(mode), &mode.metrics, false});
  for (const auto& row : report.baselines)
    out.push_back({baseline_title(row.name), &row.metrics, true});
  return out;
}

// `best`: what the best of the column reads; who reads the same is as good.
std::string value(const Summary& s, const Column& c, const std::string& best) {
  if (std::isnan(s.mean)) return "-";
  const std::string mean = formatted(c.format, c.unit * s.mean);
  std::string out = mean == best ? "<b class=\"best\">" + mean + "</b>" : mean;
  if (!std::isnan(s.se))
    out += " <small>&plusmn;" + formatted(c.format, c.unit * s.se) + "</small>";
  return out;
}

std::string best_of(const std::vector<NamedScores>& rows, const Column& c) {
  std::size_t best = rows.size();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double mean = (*rows[i].metrics)[c.metric].mean;
    if (std::isnan(mean)) continue;
    const double before = best < rows.size() ? (*rows[best].metrics)[c.metric].mean : 0;
    if (best == rows.size() || (c.less_is_better ? mean < before : mean > before)) best = i;
  }
  return best < rows.size() ? formatted(c.format, c.unit * (*rows[best].metrics)[c.metric].mean)
                            : "";
}

std::string first_table(const Report& report) {
  const auto rows = scored(report);
  std::vector<std::string> head{"made from"};
  for (const Column& c : first_columns)
    head.push_back(std::string(c.title) + (c.less_is_better ? "<br><small>less is better</small>"
                                                            : "<br><small>1 is perfect</small>"));
  head.push_back("n of the depth error<br><small>maps where body meets body</small>");
  std::vector<chart::TableRow> table;
  for (const NamedScores& row : rows)
    table.push_back({{chart::escaped(row.name)}, row.baseline ? "baseline" : ""});
  for (const Column& c : first_columns) {
    const std::string best = best_of(rows, c);
    for (std::size_t i = 0; i < rows.size(); ++i)
      table[i].cells.push_back(value((*rows[i].metrics)[c.metric], c, best));
  }
  for (std::size_t i = 0; i < rows.size(); ++i)
    table[i].cells.push_back(std::to_string((*rows[i].metrics)[metric_depth_mae_m].maps));
  const std::size_t seeds = report.modes.front().evaluations.size();
  return chart::table(formatted("%zu held-out records; mean \u00b1 standard error over %s",
                                report.records, seeds > 1 ? "trainings; n: trainings" : "maps"),
                      head, table);
}

// Metrics down, models across: it fits beside seven.
std::string all_table(const Report& report) {
  const auto rows = scored(report);
  std::vector<std::string> head{""};
  for (const NamedScores& row : rows) head.push_back(chart::escaped(row.name));
  std::vector<chart::TableRow> table;
  for (const Column& c : all_columns) {
    const std::string best = best_of(rows, c);
    table.push_back({{c.title}});
    for (std::size_t i = 0; i < rows.size(); ++i)
      table.back().cells.push_back(value((*rows[i].metrics)[c.metric], c, best));
  }
  chart::TableRow paper{{"SSIM in the paper"}, "baseline"};
  for (const auto& mode : report.modes)
    paper.cells.push_back(mode.paper_ssim ? formatted("%.4f", *mode.paper_ssim) : "-");
  paper.cells.resize(rows.size() + 1);
  table.push_back(paper);
  return "<div class=\"wide\">" + chart::table("", head, table) + "</div>";
}

std::string cost_table(const Report& report) {
  std::vector<chart::TableRow> rows;
  for (const auto& mode : report.modes) {
    const RunningCost& c = mode.evaluations.front().cost;
    rows.push_back({{chart::escaped(title_of(mode)), formatted("%.0f", c.infer_us_median),
                     formatted("%.0f", c.infer_us_p99),
                     chart::short_number(static_cast<double>(c.cost.multiply_adds)),
                     chart::short_number(static_cast<double>(c.cost.parameters)),
                     formatted("%.1f", static_cast<double>(c.model_bytes) / 1e6),
                     formatted("%.1f", c.train_s)}});
  }
  return chart::table("One map on one thread of this host",
                      {"", "time of a map (\u00b5s, median)", "99 % (\u00b5s)", "multiply-adds",
                       "parameters", "file (MB)", "training (s)"},
                      rows);
}

// What the numbers of this very table say about whole-map SSIM.
std::string ssim_note(const Report& report) {
  const Summaries& fused = report.modes.front().metrics;
  return "<p class=\"note\"><b>Do not read the SSIM column alone.</b> " +
         chart::escaped(
             "Most of a depth map is empty room, and SSIM over the whole map mostly rewards "
             "leaving it empty: " +
             formatted(
                 "answering every record with the empty room, without having looked, scores %.3f; "
                 "the first model scores %.3f raw and %.3f as a hard map. ",
                 report.baselines.front().metrics[metric_ssim].mean, fused[metric_ssim].mean,
                 fused[metric_ssim_hard].mean) +
             "The paper states neither window nor data range of its SSIM, so its values cannot be "
             "met as "
             "absolutes; what can be compared is the gap between both sensors and either one "
             "alone. IoU, "
             "lateral error and ghost say whether the body is found, and on the right side.") +
         "</p>\n" +
         chart::paragraph(
             "Ghost: of the predicted foreground beside the truth or beside its mirror image, the "
             "share at the "
             "mirror image (0: none, 0.5: as much on either side). Right side: share of bodies "
             "more than 0.3 m "
             "off the axis that are put on their true side. Hard map: what is nearer to the "
             "background than to "
             "the mean body depth is set to the background. A detector on the axis sees the same "
             "histogram of a "
             "scene and of its mirror image; the radar beside it does not, but cannot resolve the "
             "body.");
}

std::string notes_html(const std::string& of, const Evaluation& e) {
  std::string out;
  std::istringstream lines(notes(e));
  for (std::string line; std::getline(lines, line);)
    out +=
        line.starts_with("this run is like") ? chart::paragraph(of + line) : chart::note(of + line);
  return out;
}

// How much better than the best of what needs no training.
std::string against_baselines(const Report& report) {
  const Summaries& own = report.modes.front().metrics;
  double best = 0;
  std::string name;
  for (const auto& row : report.baselines)
    if (row.metrics[metric_iou].mean > best || name.empty())
      best = row.metrics[metric_iou].mean, name = baseline_title(row.name);
  const double se = std::isnan(own[metric_iou].se) ? 0 : own[metric_iou].se;
  const double ahead = own[metric_iou].mean - best;
  if (ahead > 2 * se)
    return formatted("better than every baseline (the best, %s: %.2f)", name.c_str(), best);
  return formatted("%s the best baseline (%s: %.2f)",
                   ahead < -2 * se ? "worse than" : "not better than", name.c_str(), best);
}

std::string verdict(const Report& report) {
  if (report.modes.empty()) return "The run is " + verdict_of(*report.story);
  const Summaries& own = report.modes.front().metrics;
  if (!report.differences.empty()) {
    const PairedDifference& d = report.differences.front();
    const bool open = d.low <= 0 && d.high >= 0;
    return formatted(
        "On %zu records %s: IoU %.3f and %.3f, difference %+.3f (95 %%: %+.3f to %+.3f).",
        d.records,
        open         ? "the two models cannot be told apart"
        : d.mean > 0 ? "the second model is better"
                     : "the first model is better",
        d.first, d.second, d.mean, d.low, d.high);
  }
  std::string out =
      "From " + title_of(report.modes.front()) +
      formatted(": IoU %.2f, %s", own[metric_iou].mean, against_baselines(report).c_str());
  if (!std::isnan(own[metric_lateral_m].mean))
    out += formatted("; bodies stand %.1f cm off to the side in the mean",
                     100 * own[metric_lateral_m].mean);
  if (!std::isnan(own[metric_left_right].mean))
    out += formatted(", %.0f %% on their true side", 100 * own[metric_left_right].mean);
  return out + ".";
}

std::string made_html(const Report& report) {
  std::string out = "<dl>";
  for (const auto& [name, text] : report.made)
    if (!text.empty())
      out += "<dt>" + chart::escaped(name) + "</dt><dd>" + chart::escaped(text) + "</dd>";
  return out + "</dl>\n";
}

std::string live_html(const Report& report) {
  if (!report.story) return {};
  std::string out = story_html(*report.story);
  if (!report.live) return out;
  out += notes_html("", *report.live);
  std::vector<NamedScores> rows{{title_of(report.modes.front()), &report.live->metrics, false}};
  for (const auto& row : report.live->baselines)
    rows.push_back({baseline_title(row.name), &row.metrics, true});
  std::vector<std::string> head{"made from"};
  std::vector<chart::TableRow> table;
  for (const NamedScores& row : rows)
    table.push_back({{chart::escaped(row.name)}, row.baseline ? "baseline" : ""});
  for (const Column& c : first_columns) {
    head.push_back(c.title);
    const std::string best = best_of(rows, c);
    for (std::size_t i = 0; i < rows.size(); ++i)
      table[i].cells.push_back(value((*rows[i].metrics)[c.metric], c, best));
  }
  return out + chart::table(
                   formatted("%zu live records against their depth camera", report.live->records),
                   head, table);
}

// The text about a record that the operator needs beside its picture.
std::string records_html(const Report& report) {
  std::string out;
  for (const ShownRecord& shown : report.main) out += record_html(shown);
  return out;
}

constexpr const char* cloud_style =
    "<style>#cloud-box{position:relative;overflow:hidden}#cloud{display:block;width:100%;touch-"
    "action:none;"
    "cursor:grab}#cloud-box "
    "span{position:absolute;transform:translate(4px,-50%);color:var(--quiet);"
    "font-size:13px;pointer-events:none}button{font:inherit;color:inherit;background:var(--paper);"
    "border:1px solid var(--edge);border-radius:6px;padding:4px "
    "12px;min-height:34px;cursor:pointer}"
    "button[aria-pressed=true]{background:var(--ink);color:var(--paper)}</style>";

}  // namespace

// Of compared models the file's name without its folder.
std::string short_name(const ModeResult& mode) {
  return mode.name.substr(mode.name.rfind('/') + 1);
}

std::string title_of(const ModeResult& mode) {
  const std::string model = mode.evaluations.empty() ? "" : mode.evaluations.front().model;
  const std::string seeds =
      mode.evaluations.size() > 1 ? formatted(" (%zu trainings)", mode.evaluations.size()) : "";
  const bool compared = mode.name != "fused" && mode.name != "spd" && mode.name != "radar" &&
                        mode.name != "paper" && mode.name != "live";
  if (compared) return short_name(mode) + " (" + model + ")";
  if (mode.name == "paper") return "both sensors, the paper's network" + seeds;
  const char* what = both_sensors(mode.inputs)    ? "both sensors"
                     : mode.inputs == Inputs::spd ? "detector alone"
                                                  : "radar alone";
  return std::string(what) + ", " + model + seeds;
}

std::string to_html(const Report& report) {
  const bool compare = !report.differences.empty();
  chart::Page page(report.modes.empty() ? "A recorded run"
                   : compare            ? "Two models on the same records"
                                        : "Depth maps from one pixel and one radar");
  page.lead("<p class=\"verdict\">" + chart::escaped(verdict(report)) + "</p>\n");
  page.lead("<p class=\"quiet\">" +
            (report.modes.empty() ? "" : std::to_string(report.records) + " held-out records of ") +
            chart::escaped(report.run) + " (run " + chart::escaped(report.run_uuid) +
            "), echofuse " + version() + "</p>\n");
  if (!report.modes.empty()) {
    if (!report.main.empty()) page.lead(first_html(report.main.front()));
    page.lead(first_table(report));
    std::string all_notes;
    for (const auto& mode : report.modes) {
      const std::string of = report.modes.size() > 1 ? title_of(mode) + ": " : "";
      all_notes += notes_html(of, mode.evaluations.front());
      if (!compare) break;  // the same records: the others say the same
    }
    page.section("difference", "The difference", comparison_html(report));
    page.section("cost", "Cost", cost_table(report));
    page.section("failures", "What fails", all_notes + failures_html(report));
    page.section("gallery", "Worst, median, best", gallery_html(report.gallery));
    page.section("errors", "Where the errors are", errors_html(report));
    page.section("labels", "By label", labels_html(report.modes.front()));
    page.section("letters", "Letters", letters_html(report.letters));
    page.section("metrics", "All metrics", all_table(report) + ssim_note(report));
    page.section("records", "Records and their maps", records_html(report));
    if (!report.main.empty()) {
      page.section("space", "In space", cloud_style + cloud_html(report.main.front()));
      page.script(cloud_script(report.main.front()));
    }
    page.section("training", "Training", losses_html(report));
  }
  page.section("live", "The recorded run", live_html(report));
  page.section("made", "How this was made", made_html(report));
  return page.html();
}

std::string to_text(const Report& report) {
  std::string out = verdict(report) + "\n";
  if (report.modes.empty()) return out;
  out += formatted("%-10s %10s %16s %16s %16s %16s %16s\n", "mode", "paper SSIM", "SSIM", "IoU",
                   "lateral (m)", "ghost", "left/right");
  const auto line = [&](const std::string& name, const std::string& paper,
                        const Summaries& metrics) {
    out += formatted("%-10s %10s", name.c_str(), paper.c_str());
    for (const Metric m :
         {metric_ssim, metric_iou, metric_lateral_m, metric_ghost, metric_left_right})
      out += formatted(" %16s", formatted(metrics[m], " +-").c_str());
    out += '\n';
  };
  for (const auto& mode : report.modes)
    line(short_name(mode), mode.paper_ssim ? formatted("%.4f", *mode.paper_ssim) : "",
         mode.metrics);
  for (const auto& row : report.baselines) line(row.name, "", row.metrics);
  out += notes(report.modes.front().evaluations.front());
  for (const PairedDifference& d : report.differences)
    out += formatted("%-12s %6zu records: %.4f, %.4f; difference %+.4f (95 %%: %+.4f to %+.4f)\n",
                     metric_names[d.metric], d.records, d.first, d.second, d.mean, d.low, d.high);
  if (report.live) {
    line("live", "", report.live->metrics);
    out += notes(*report.live);
  }
  return out;
}

}  // namespace echofuse::recon
