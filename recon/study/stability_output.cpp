// SPDX-License-Identifier: MIT
// The page, the charts and the text of a study of stability.
#include <algorithm>
#include <cctype>
#include <cmath>

#include "drivers/chart/chart.hpp"
#include "drivers/chart/page.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/program/atomic_write.hpp"
#include "drivers/program/console.hpp"
#include "recon/data/files.hpp"
#include "recon/numbers/text.hpp"
#include "recon/study/model_colours.hpp"
#include "recon/study/stability.hpp"

namespace echofuse::recon {
namespace {

bool fails_at_base(const StabilityCurve& curve, const StabilityAxis& axis) {
  return curve.points[axis.base()].fails;
}

std::string shared(double worst) { return std::isnan(worst) ? "-" : formatted("%.2f", worst); }

std::string cell(const StabilityCurve& curve, const StabilityAxis& axis) {
  if (fails_at_base(curve, axis)) return "<b class=\"bad\">fails at the base</b>";
  std::string out = shared(curve.worst);
  if (!curve.fails_at.empty())
    out += "<br><b class=\"bad\">fails at " + joined(curve.fails_at, ", ") + "</b>";
  if (!curve.halved_at.empty())
    out += "<br><small>half at " + joined(curve.halved_at, ", ") + "</small>";
  return out;
}

std::string table(const std::vector<StabilityResult>& results) {
  std::vector<std::string> head{"condition"};
  chart::TableRow base_row{{"IoU at the base"}, "baseline"};
  for (const auto& curve : results.front().curves) {
    head.push_back(chart::escaped(curve.name));
    const StabilityPoint& base = curve.points[results.front().axis.base()];
    base_row.cells.push_back(formatted("%.3f <small>&plusmn;%.3f</small>", base.mean[metric_iou],
                                       base.spread[metric_iou]));
  }
  std::vector<chart::TableRow> rows{base_row};
  for (const auto& [axis, curves, baselines] : results) {
    std::string values = axis.values[axis.base()].label + ", then ";
    for (std::size_t i = 0; i < axis.values.size(); ++i)
      if (i != axis.base()) values += axis.values[i].label + ", ";
    values.resize(values.size() - 2);
    chart::TableRow row{{"<a href=\"#" + axis.id() + "\">" + chart::escaped(axis.title) +
                         "</a><br><small>" + axis.kind() + "; " + chart::escaped(values) +
                         "</small>"}};
    for (const auto& curve : curves) row.cells.push_back(cell(curve, axis));
    rows.push_back(row);
  }
  return chart::table("Least IoU on the axis, as a share of that at the base", head, rows);
}

std::string capitalised(std::string text);
std::vector<chart::Panel> panels_of(const StabilityOptions& o, const StabilityResult& result);

std::string to_html(const StabilityOptions& o, const std::vector<StabilityResult>& results) {
  chart::Page page("What fails first");
  page.lead(chart::paragraph(
      formatted("%zu training records, %zu fresh ones to judge by, %zu seed%s, echofuse ",
                o.records, o.test_records, o.seeds, o.seeds == 1 ? "" : "s") +
      version() + "."));
  page.section(
      "table", "All conditions",
      chart::paragraph("Matched: trained and tested under the condition. Shifted: trained at the "
                       "base condition, tested under this one. Sorted by what breaks the first "
                       "model most.") +
          chart::paragraph(
              "A model fails where its map is no better than no map: its hard SSIM is not above "
              "the empty room's, or its IoU is not above that of empty room and mean map (by more "
              "than the spread over seeds), or there is no map at all. Of single records that it "
              "cannot read it shows the empty room. Half: its IoU falls below half of the "
              "base's.") +
          table(results));
  for (const auto& result : results) {
    std::vector<std::string> drawings;
    for (const chart::Panel& p : panels_of(o, result))
      drawings.push_back(chart::for_both_widths(p));
    page.section(result.axis.id(), capitalised(result.axis.title) + ", " + result.axis.kind(),
                 chart::figure(drawings, "As a file: " + result.axis.id() + ".svg"));
  }
  return page.html();
}

// Numbers are drawn to scale, words one beside the other. A 0 on a logarithmic scale stands a
// decade to the left of the least other value.
struct Positions {
  std::vector<double> at;
  bool log = false, zero = false;  // zero: there is such a 0
};
Positions positions_of(const StabilityAxis& axis) {
  Positions out;
  for (std::size_t i = 0; i < axis.values.size(); ++i) {
    const std::string& label = axis.values[i].label;
    char* end = nullptr;
    out.at.push_back(std::strtod(label.c_str(), &end));
    if (end == label.c_str() || *end != 0) {
      for (std::size_t k = 0; k < axis.values.size(); ++k)
        out.at.resize(k), out.at.push_back(static_cast<double>(k));
      return out;
    }
  }
  double least = INFINITY, most = 0;
  for (const double v : out.at)
    if (v > 0) least = std::min(least, v), most = std::max(most, v);
  out.log = most > 8 * least;
  if (out.log)
    for (double& v : out.at)
      if (v <= 0) v = least / 10, out.zero = true;
  return out;
}

std::string capitalised(std::string text) {
  if (!text.empty()) text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
  return text;
}

chart::Series series_of(const StabilityCurve& curve, const Positions& x, const StabilityAxis& axis,
                        Metric metric) {
  chart::Series line{name_in_charts(curve.name), {}};
  for (std::size_t i = 0; i < curve.points.size(); ++i) {
    const double mean = curve.points[i].mean[metric], spread = curve.points[i].spread[metric];
    chart::Point point{x.at[i], mean};
    if (spread > 0) point.low = mean - spread, point.high = mean + spread;
    point.crossed = std::ranges::count(curve.fails_at, axis.values[i].label) > 0;
    line.points.push_back(point);
  }
  std::sort(line.points.begin(), line.points.end(),
            [](const auto& a, const auto& b) { return a.x < b.x; });
  return line;
}

std::string meaning_of(const StabilityAxis& axis) {
  return axis.kind() == std::string("matched") ? "trained and tested under each condition"
                                               : "trained at the base, tested under each condition";
}

std::vector<chart::Panel> panels_of(const StabilityOptions& o, const StabilityResult& result) {
  const Positions x = positions_of(result.axis);
  std::vector<chart::Panel> out;
  for (const Metric metric : {metric_iou, metric_ssim_hard}) {
    chart::Panel panel{"",
                       {result.axis.title, x.log},
                       {metric == metric_iou ? "IoU" : "SSIM of the hard map", false,
                        metric == metric_iou ? 0 : 0.5, metric == metric_iou ? chart::nan : 1},
                       {},
                       {{x.at[result.axis.base()], "base", true}}};
    panel.width = 560, panel.height = 380;
    panel.note = formatted(
        "Means of %zu seed%s, bars: their spread; %zu records to train, %zu to "
        "judge by. Cross: from here on the model fails, its map is no better "
        "than no map; it may do so at the base.",
        o.seeds, o.seeds == 1 ? " (no bars)" : "s", o.records, o.test_records);
    if (x.zero) panel.note += " 0 stands a decade left of the least value.";
    for (std::size_t i = 0; i < x.at.size(); ++i) {
      const std::string& label = result.axis.values[i].label;
      char* end = nullptr;
      const double value = std::strtod(label.c_str(), &end);
      panel.x.ticks.emplace_back(x.at[i], *end == 0 ? chart::short_number(value) : label);
    }
    std::sort(panel.x.ticks.begin(), panel.x.ticks.end());
    for (const auto& curve : result.baselines) {
      panel.series.push_back(series_of(curve, x, result.axis, metric));
      panel.series.back().colour = chart::grey, panel.series.back().dashed = true;
      panel.series.back().look = chart::Look::line;
      for (auto& point : panel.series.back().points)
        point.low = point.high = chart::nan, point.crossed = false;
    }
    ModelColours colours;
    for (const auto& curve : result.curves) {
      panel.series.push_back(series_of(curve, x, result.axis, metric));
      panel.series.back().colour = colours.of(curve.name);
    }
    out.push_back(panel);
  }
  return out;
}

}  // namespace

void draw_stability(const StabilityOptions& options, const std::vector<StabilityResult>& results) {
  write_atomically(options.out + "/stability.html", to_html(options, results));
  for (const auto& result : results)
    write_atomically(options.out + "/" + result.axis.id() + ".svg",
                     chart::stand_alone(capitalised(result.axis.title) + ", " + result.axis.kind() +
                                            ": " + meaning_of(result.axis),
                                        panels_of(options, result), 2));
}

std::string to_text(const std::vector<StabilityResult>& results) {
  std::string out =
      formatted("%-26s %-18s %10s  %s\n", "condition", "model", "worst IoU", "fails at; half at");
  for (const auto& [axis, curves, baselines] : results)
    for (const auto& curve : curves) {
      const bool base = fails_at_base(curve, axis);
      out += formatted("%-26s %-18s %10s  ", axis.id().c_str(), curve.name.c_str(),
                       shared(curve.worst).c_str());
      out += (base                     ? "the base"
              : curve.fails_at.empty() ? "-"
                                       : joined(curve.fails_at, ", ")) +
             "; " + (curve.halved_at.empty() ? "-" : joined(curve.halved_at, ", ")) + "\n";
    }
  return out;
}

}  // namespace echofuse::recon
