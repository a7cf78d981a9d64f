// SPDX-License-Identifier: MIT
#include <cmath>
#include <sstream>

#include "drivers/core/console.hpp"
#include "drivers/core/printable.hpp"
#include "recon/files/text.hpp"
#include "recon/output/report.hpp"

namespace echofuse::recon {
namespace {

struct Column {
  Metric metric;
  const char* title;
};
constexpr Column columns[] = {
    {metric_ssim, "SSIM"},
    {metric_ssim_hard, "SSIM, hard map"},
    {metric_ssim_fg, "SSIM near the body"},
    {metric_iou, "IoU"},
    {metric_rmse_m, "RMSE (m)"},
    {metric_depth_mae_m, "depth MAE (m)"},
    {metric_lateral_m, "lateral error (m)"},
    {metric_ghost, "ghost"},
    {metric_left_right, "left/right"},
};

constexpr double flagged_often = 0.05;  // of a run: something about it is not as in the training

constexpr const char* style = R"(
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1240px; margin: 2em auto;
  padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; }
table { border-collapse: collapse; font-size: 13px; }
th, td { padding: .35em .7em; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap; }
th { border-bottom: 2px solid #888; white-space: normal; vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
figure { margin: 2em 0; } figcaption { color: #555; }
tr.baseline td { color: #777; } small { color: #888; }
img { max-width: 100%; border: 1px solid #ddd; }
td.flag { background: #b3261e; color: white; font-weight: bold; }
p.note { background: #f6f3e6; padding: .7em 1em; border-left: 4px solid #c9b458; }
)";

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : printable(text)) {
    if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += c;
  }
  return out;
}

std::string base64(ByteView bytes) {
  constexpr char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t n = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t block = 0;
    for (std::size_t k = 0; k < 3; ++k) block = block << 8 | (k < n ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= n ? digits[block >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

std::string metric_cells(const Summaries& metrics) {
  std::string out;
  for (const auto& c : columns) {
    const Summary& s = metrics[c.metric];
    out += "<td>" + (std::isnan(s.mean) ? std::string("-") : formatted("%.3f", s.mean));
    if (!std::isnan(s.mean) && !std::isnan(s.se))
      out += formatted(" <small>&plusmn;%.3f</small>", s.se);
    out += "</td>";
  }
  return out;
}

std::string header_row(const std::string& first, const std::string& last) {
  std::string out = "<tr><th></th>" + first;
  for (const auto& c : columns) out += std::string("<th>") + c.title + "</th>";
  return out + last + "</tr>\n";
}

std::string mode_row(const ModeResult& mode) {
  const Evaluation& e = mode.evaluations.front();
  std::string out = "<tr><td>" + mode.name + " (" + escaped(e.model) + ")</td>";
  out += formatted("<td>%.4f</td>", mode.paper_ssim) + metric_cells(mode.metrics);
  out += formatted("<td>%.0f</td><td>%.2f</td><td>%.0f</td></tr>\n", e.cost.infer_us_median,
                   static_cast<double>(e.cost.cost.multiply_adds) / 1e6, e.cost.train_s);
  return out;
}

std::string modes_table(const Report& report) {
  std::string out = "<table>\n" + header_row("<th>paper's SSIM</th>",
                                             "<th>&micro;s a map</th><th>million multiply-adds</th>"
                                             "<th>training (s)</th>");
  for (const auto& mode : report.modes) out += mode_row(mode);
  for (const auto& row : report.baselines)
    out += "<tr class=\"baseline\"><td>" + escaped(row.name) + "</td><td></td>" +
           metric_cells(row.metrics) + "<td></td><td></td><td></td></tr>\n";
  return out + "</table>\n";
}

// What the numbers of this very table say about whole-map SSIM.
std::string ssim_note(const Report& report) {
  std::string out =
      "<p class=\"note\"><b>Do not read the SSIM column alone.</b> Most of a depth map is empty "
      "room, and SSIM over the whole map mostly rewards leaving it empty: ";
  out +=
      formatted("answering every record with the empty room, without having looked, scores %.3f; ",
                report.baselines.front().metrics[metric_ssim].mean);
  const Summaries& fused = report.modes.front().metrics;
  out += formatted("the fused model scores %.3f raw and %.3f as a hard map. ",
                   fused[metric_ssim].mean, fused[metric_ssim_hard].mean);
  return out +
         "The paper states neither window nor data range of its SSIM, so its values cannot be met "
         "as "
         "absolutes; what can be compared is the gap between the fused mode and either sensor "
         "alone. "
         "IoU, lateral error and ghost say whether the body is found, and on the right side.</p>\n";
}

std::string explanations(const Report& report) {
  const std::size_t seeds = report.modes.front().evaluations.size();
  std::string out = "<p>Mean &plusmn; ";
  out += seeds > 1 ? formatted("standard error over %zu trainings.", seeds)
                   : std::string("standard error over maps.");
  return out +
         " Ghost: of the predicted foreground beside the truth or beside its mirror image, the "
         "share at the mirror image (0: none, 0.5: as much on either side). Left/right: share of "
         "bodies more than 0.3 m off the axis that are put on their true side. Hard map: "
         "predictions nearer to "
         "the background than to the mean body depth are set to the background. An SPD on the axis "
         "sees the same histogram for a scene and its mirror image; the radar beside it does not, "
         "but cannot resolve the body.</p>\n";
}

// What the models say of themselves, and how it holds: one line a mode.
std::string uncertainty_section(const Report& report) {
  std::string lines;
  const auto add = [&](const std::string& name, const Evaluation& e) {
    if (!e.calibration) {
      lines += "<tr><td>" + escaped(name) + "</td><td colspan=\"5\">not calibrated</td></tr>\n";
      return;
    }
    const UncertaintyCalibration& c = *e.calibration;
    const auto cell = [](const char* form, double value) {
      return "<td>" + (std::isnan(value) ? std::string("-") : formatted(form, value)) + "</td>";
    };
    lines += "<tr><td>" + escaped(name) + "</td>" + cell("%.3f", c.lateral_interval_90_m) +
             cell("%.1f %%", 100 * c.within_90) + cell("%.2f", c.deviation_m) +
             cell("%.2f", c.error_m) +
             formatted("<td class=\"%s\">%.1f %%</td></tr>\n",
                       c.flagged > flagged_often ? "flag" : "", 100 * c.flagged);
  };
  for (const auto& mode : report.modes) add(mode.name, mode.evaluations.front());
  if (!report.live.empty()) add(report.live, report.live_evaluation);
  if (lines.empty()) return {};
  return "<h2>How sure the models are</h2>\n<table>\n<tr><th></th><th>stated lateral error, 90 % "
         "(m)</th><th>records within it</th><th>stated uncertainty of a pixel (m, rms)</th>"
         "<th>error of the mean map (m, rms)</th><th>out of distribution</th></tr>\n" +
         lines + "</table>\n";
}

// notes() as paragraphs.
std::string notes_section(const Evaluation& e) {
  std::string out;
  std::istringstream lines(notes(e));
  for (std::string line; std::getline(lines, line);)
    out += "<p class=\"note\">" + escaped(line) + "</p>\n";
  return out;
}

std::string live_section(const Report& report) {
  if (report.live.empty()) return {};
  std::string out = "<h2>Recorded live: " + escaped(report.live) + "</h2>\n<p>" +
                    std::to_string(report.live_evaluation.records) +
                    " records through the daemon, scored with the fused model.</p>\n" +
                    notes_section(report.live_evaluation) + "<table>\n" + header_row("", "");
  out += "<tr><td>fused</td>" + metric_cells(report.live_evaluation.metrics) + "</tr>\n";
  for (const auto& row : report.live_evaluation.baselines)
    out += "<tr class=\"baseline\"><td>" + escaped(row.name) + "</td>" + metric_cells(row.metrics) +
           "</tr>\n";
  return out + "</table>\n";
}

}  // namespace

std::string to_html(const Report& report) {
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>echofuse "
      "report</title>"
      "<style>" +
      std::string(style) +
      "</style></head><body>\n<h1>Depth maps from one pixel and one "
      "radar</h1>\n<p>" +
      std::to_string(report.records) + " held-out records of " + escaped(report.run) + " (run " +
      escaped(report.run_uuid) + "), echofuse " + version() + ".</p>\n";
  out += notes_section(report.modes.front().evaluations.front()) + modes_table(report) +
         explanations(report) + ssim_note(report) + uncertainty_section(report) +
         live_section(report);
  for (const auto& picture : report.pictures)
    out += "<figure><img alt=\"" + escaped(picture.file) + "\" src=\"data:image/png;base64," +
           base64(picture.png) + "\"><figcaption>" + escaped(picture.caption) +
           "</figcaption></figure>\n";
  return out + "</body></html>\n";
}

std::string to_text(const Report& report) {
  std::string out = formatted("%-8s %10s %16s %16s %16s %16s %16s\n", "mode", "paper SSIM", "SSIM",
                              "IoU", "lateral (m)", "ghost", "left/right");
  const auto line = [&](const char* name, const std::string& paper, const Summaries& metrics) {
    out += formatted("%-8s %10s", name, paper.c_str());
    for (const Metric m :
         {metric_ssim, metric_iou, metric_lateral_m, metric_ghost, metric_left_right})
      out += formatted(" %16s", formatted(metrics[m], " +-").c_str());
    out += '\n';
  };
  for (const auto& mode : report.modes)
    line(mode.name.c_str(), formatted("%.4f", mode.paper_ssim), mode.metrics);
  for (const auto& row : report.baselines) line(row.name.c_str(), "", row.metrics);
  out += notes(report.modes.front().evaluations.front());
  if (!report.live.empty()) {
    line("live", "", report.live_evaluation.metrics);
    out += notes(report.live_evaluation);
  }
  return out;
}

}  // namespace echofuse::recon
