// SPDX-License-Identifier: MIT
// The page, the charts and the text of a study of stability.
#include <algorithm>
#include <cmath>
#include <sstream>

#include "drivers/chart/gnuplot.hpp"
#include "drivers/core/console.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"
#include "recon/study/stability_summary.hpp"

namespace echofuse::recon {
namespace {

constexpr const char* style = R"(
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1240px; margin: 2em auto;
  padding: 0 1em; }
table { border-collapse: collapse; font-size: 13px; }
th, td { padding: .35em .7em; border-bottom: 1px solid #ddd; text-align: left; }
td.lost { background: #f6d5d0; } td.half { background: #f6f0d0; } small { color: #777; }
img { max-width: 100%; }
)";

std::string joined(const std::vector<std::string>& parts) {
  std::string out;
  for (const auto& part : parts) out += (out.empty() ? "" : ", ") + part;
  return out;
}

bool fails_at_base(const StabilityCurve& curve, const StabilityAxis& axis) {
  return curve.points[axis.base()].fails;
}

std::string shared(double worst) { return std::isnan(worst) ? "-" : formatted("%.2f", worst); }

std::string cell(const StabilityCurve& curve, const StabilityAxis& axis) {
  if (fails_at_base(curve, axis)) return "<td class=\"lost\">at the base</td>";
  const char* colour = !curve.fails_at.empty()    ? " class=\"lost\""
                       : !curve.halved_at.empty() ? " class=\"half\""
                                                  : "";
  std::string out = formatted("<td%s><b>%s</b>", colour, shared(curve.worst).c_str());
  if (!curve.fails_at.empty()) out += "<br>fails at " + joined(curve.fails_at);
  if (!curve.halved_at.empty()) out += "<br><small>half at " + joined(curve.halved_at) + "</small>";
  return out + "</td>";
}

std::string table(const std::vector<StabilityResult>& results) {
  std::string out = "<table>\n<tr><th>condition</th><th>base, then</th>";
  for (const auto& curve : results.front().curves) out += "<th>" + curve.name + "</th>";
  out += "</tr>\n<tr><td>IoU at the base</td><td></td>";
  for (const auto& curve : results.front().curves) {
    const StabilityPoint& base = curve.points[results.front().axis.base()];
    out += formatted("<td>%.3f <small>&plusmn;%.3f</small></td>", base.mean[metric_iou],
                     base.spread[metric_iou]);
  }
  out += "</tr>\n";
  for (const auto& [axis, curves, baselines] : results) {
    std::string values = axis.values[axis.base()].label + ";";
    for (std::size_t i = 0; i < axis.values.size(); ++i)
      if (i != axis.base()) values += " " + axis.values[i].label + ",";
    values.back() = ' ';
    out += "<tr><td><a href=\"#" + axis.id() + "\">" + axis.title + "</a><br><small>" +
           axis.kind() + "</small></td><td>" + values + "</td>";
    for (const auto& curve : curves) out += cell(curve, axis);
    out += "</tr>\n";
  }
  return out + "</table>\n";
}

std::string to_html(const StabilityOptions& o, const std::vector<StabilityResult>& results) {
  std::string out =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>What fails "
      "first</title><style>" +
      std::string(style) + "</style></head><body>\n<h1>What fails first</h1>\n<p>";
  out += std::to_string(o.records) + " training records, " + std::to_string(o.test_records) +
         " fresh ones to judge by, " + std::to_string(o.seeds) + " seeds, range bias " +
         (o.range_bias == RangeBiasAction::correct ? "corrected" : "not corrected") +
         ", echofuse " + version() +
         ". <i>matched</i>: trained and tested under the condition; <i>shifted</i>: trained at the "
         "base condition, tested under this one. Each cell: least IoU on the axis as a share of "
         "that at the base. A model <b>fails</b> where its map is no better than no map: hard SSIM "
         "not above the empty room's, IoU not above that of empty room and mean map (by more than "
         "the spread over seeds), or no map at all; of single records that it cannot read it shows "
         "the empty room. <small>half</small>: where its IoU falls below "
         "half of the base's. Sorted by what breaks the first model most.</p>\n" +
         table(results);
  for (const auto& result : results)
    out += "<h2 id=\"" + result.axis.id() + "\">" + result.axis.title + ", " + result.axis.kind() +
           "</h2>\n<img alt=\"IoU and hard SSIM\" src=\"" + result.axis.id() + ".svg\">\n";
  return out + "</body></html>\n";
}

std::string number(char before, double v) {
  return std::isnan(v) ? formatted("%cnan", before) : formatted("%c%.6g", before, v);
}

std::string to_csv(const std::vector<Measurement>& rows) {
  std::ostringstream csv;
  csv << "kind,axis,value,model,inputs,seed";
  for (const Metric m : stability_metrics) csv << ',' << metric_names[m];
  for (const Measurement& r : rows) {
    const std::size_t dash = r.axis.find('-');  // none in "base"
    csv << '\n'
        << r.axis.substr(0, dash) << ',' << r.axis.substr(dash + 1) << ',' << r.value << ','
        << r.model << ',' << r.inputs << ',' << r.seed;
    for (const Metric m : stability_metrics) csv << number(',', r.metric(metric_names[m]));
  }
  csv << '\n';
  return csv.str();
}

bool fails_at(const StabilityCurve& curve, const std::string& label) {
  return std::find(curve.fails_at.begin(), curve.fails_at.end(), label) != curve.fails_at.end();
}

// A line a value: label, then for each curve IoU, spread, IoU if it is the first value at which the
// model fails, and the same of SSIM.
std::string data_block(const StabilityResult& result, std::vector<const StabilityCurve*> curves) {
  std::string out = "$data << EOD\n";
  for (std::size_t i = 0; i < result.axis.values.size(); ++i) {
    out += '"' + result.axis.values[i].label + '"';
    for (const StabilityCurve* curve : curves)
      for (const Metric m : {metric_iou, metric_ssim_hard}) {
        const StabilityPoint& p = curve->points[i];
        const bool fails = fails_at(*curve, result.axis.values[i].label);
        for (const double v : {p.mean[m], p.spread[m], fails ? p.mean[m] : NAN})
          out += number(' ', v);
      }
    out += '\n';
  }
  return out + "EOD\n";
}

// Of all values, or of those at which the model begins to lose.
bool has_points(const StabilityResult& result, const StabilityCurve& curve, Metric metric,
                bool failing) {
  for (std::size_t i = 0; i < curve.points.size(); ++i)
    if (!std::isnan(curve.points[i].mean[metric]) &&
        (!failing || fails_at(curve, result.axis.values[i].label)))
      return true;
  return false;
}

constexpr std::size_t colours = 8;  // of gnuplot; then dashes

// Curves with something to draw, those of the baselines first; where a model begins to fail, a
// cross.
std::string plot(const StabilityResult& result, const std::vector<const StabilityCurve*>& curves,
                 Metric metric) {
  const std::size_t baselines = result.baselines.size();
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < curves.size(); ++i) {
    if (!has_points(result, *curves[i], metric, false)) continue;
    const std::size_t column = 2 + 6 * i + (metric == metric_iou ? 0 : 3);
    const std::size_t model = i < baselines ? 0 : i - baselines, colour = 1 + model % colours;
    const std::string look = i < baselines ? formatted("lines dt %zu lw 2 lc 'gray40'", 2 + i)
                                           : formatted("yerrorlines pt 7 ps 0.5 lc %zu dt %zu",
                                                       colour, 1 + model / colours);
    parts.push_back(formatted("$data using 0:%zu:%zu:xtic(1) with ", column, column + 1) + look +
                    (metric == metric_iou ? " title '" + curves[i]->name + "'" : " notitle"));
    if (i >= baselines && has_points(result, *curves[i], metric, true))
      parts.push_back(formatted("$data using 0:%zu with points pt 2 ps 1.6 lw 3 lc %zu notitle",
                                column + 2, colour));
  }
  return "plot " + joined(parts) + "\n";
}

std::string chart(const StabilityResult& result) {
  std::vector<const StabilityCurve*> curves;
  for (const auto& curve : result.baselines) curves.push_back(&curve);
  for (const auto& curve : result.curves) curves.push_back(&curve);
  std::string out = data_block(result, curves) + "set output '" + result.axis.id() + ".svg'\n";
  out += formatted("set xrange [-0.4:%g]\n", static_cast<double>(result.axis.values.size()) - 0.6);
  out += formatted("set arrow 1 from %zu,graph 0 to %zu,graph 1 nohead dt 3 lc 'gray'\n",
                   result.axis.base(), result.axis.base());
  out += "set xlabel \"" + result.axis.title + "\"\n";
  out += "set multiplot layout 1,2\n";
  out += "set ylabel 'IoU of the foreground'; set yrange [-0.02:0.1<*]\n" +
         plot(result, curves, metric_iou);
  out += "set ylabel 'SSIM of the hard map'; set yrange [*<0.78:0.84<*]\n" +
         plot(result, curves, metric_ssim_hard);
  return out + "unset multiplot\n";
}

constexpr const char* chart_head = R"(set datafile missing 'nan'
set terminal svg noenhanced size 1200,500 font 'sans,12' background 'white'
set grid y; set xtics rotate by -20; set bmargin at screen 0.3; set tmargin at screen 0.97
set key at screen 0.5,0.01 center bottom vertical maxrows 3
)";

}  // namespace

void write_stability(const StabilityOptions& options, const std::vector<Measurement>& rows,
                     const std::vector<StabilityResult>& results) {
  write_text(options.out + "/stability.csv", to_csv(rows));
  const std::string page = options.out + "/stability.html";
  write_text(page, to_html(options, results));
  std::string script = chart_head;
  for (const auto& result : results) script += chart(result);
  run_gnuplot(script, options.out, page + " is written, but ");
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
                                       : joined(curve.fails_at)) +
             "; " + (curve.halved_at.empty() ? "-" : joined(curve.halved_at)) + "\n";
    }
  return out;
}

}  // namespace echofuse::recon
