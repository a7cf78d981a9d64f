// SPDX-License-Identifier: MIT
// The page and the text of a study of stability.
#include <algorithm>
#include <cctype>
#include <cmath>

#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "recon/numbers/text.hpp"
#include "recon/study/stability.hpp"
#include "recon/study/study_page.hpp"

namespace echofuse::recon {
namespace {

bool fails_at_base(const StabilityCurve& curve, const StabilityAxis& axis) {
  return curve.points[axis.base()].fails;
}

std::string shared(double worst) { return std::isnan(worst) ? "-" : formatted("%.2f", worst); }

std::string listed(const StabilityAxis& axis) {
  std::vector<std::string> others;
  for (const AxisValue& value : axis.values)
    if (&value != &axis.values[axis.base()]) others.push_back(value.label);
  return axis.values[axis.base()].label + ", then " + joined(others, ", ");
}

Json cell_of(const StabilityCurve& curve, const StabilityAxis& axis) {
  if (fails_at_base(curve, axis)) return cell("fails at the base", "", "bad");
  const std::string half =
      curve.halved_at.empty() ? "" : "half at " + joined(curve.halved_at, ", ");
  if (curve.fails_at.empty()) return cell(shared(curve.worst), half);
  return cell(shared(curve.worst) + ", fails at " + joined(curve.fails_at, ", "), half, "bad");
}

Json table_of(const std::vector<StabilityResult>& results) {
  Json head = Json::array({words("condition")}), base = Json::array({cell("IoU at the base", "")});
  for (const auto& curve : results.front().curves) {
    head.push_back(words(name_in_charts(curve.name)));
    const StabilityPoint& at = curve.points[results.front().axis.base()];
    base.push_back(cell(formatted("%.3f", at.mean[metric_iou]),
                        formatted("\u00b1%.3f", at.spread[metric_iou])));
  }
  Json rows = Json::array({base});
  for (const auto& [axis, curves, baselines] : results) {
    Json row = Json::array({cell(axis.title, axis.kind() + "; " + listed(axis))});
    for (const auto& curve : curves) row.push_back(cell_of(curve, axis));
    rows.push_back(row);
  }
  return table("Least IoU on the axis, as a share of that at the base", head, rows);
}

// A line over the values of the axis, one beside the other.
Json& add_line(Json& panel, const std::string& name, const std::string& colour, Look look,
               const StabilityCurve& curve) {
  std::vector<std::pair<double, double>> line;
  for (std::size_t i = 0; i < curve.points.size(); ++i)
    line.emplace_back(i, curve.points[i].mean[metric_iou]);
  return add_series(panel, name, colour, look, line);
}

// At each value the best of empty room, mean map and nearest training record, by IoU: those that
// draw no body have none. Named as the best at the base.
StabilityCurve best_baseline(const StabilityResult& result) {
  std::vector<const StabilityCurve*> all;
  for (const auto* curves : {&result.baselines, &result.curves})
    for (const StabilityCurve& curve : *curves)
      if (curves == &result.baselines || curve.name == nearest_baseline) all.push_back(&curve);
  StabilityCurve best = *all.front();
  for (const StabilityCurve* curve : all)
    for (std::size_t i = 0; i < best.points.size(); ++i)
      if (const double iou = curve->points[i].mean[metric_iou];
          iou >= best.points[i].mean[metric_iou]) {
        best.points[i].mean[metric_iou] = iou;
        if (i == result.axis.base()) best.name = curve->name;
      }
  return best;
}

std::string told(const StabilityCurve& curve) {
  return curve.fails_at.empty() ? "holds" : "fails at " + joined(curve.fails_at, ", ");
}

Json panel_of(const StabilityResult& result) {
  const StabilityAxis& axis = result.axis;
  Json out = chart(axis.title + ", " + axis.kind(), "", "IoU"), names = Json::array();
  for (const AxisValue& value : axis.values) names.push_back(value.label);
  out["ticks"] = names, out["height"] = 240;
  add_rule(out, static_cast<double>(axis.base()), "base");
  const StabilityCurve baseline = best_baseline(result);
  add_line(out, std::string("best baseline: ") + baseline_title(baseline.name), "grey", Look::line,
           baseline)["shaded"] = true;
  ModelColours colours;
  for (const StabilityCurve& curve : result.curves) {
    if (curve.name == baseline.name) continue;
    Json& line = add_line(out, name_in_charts(curve.name) + ": " + told(curve),
                          colours.of(curve.name), Look::marked, curve);
    for (const StabilityPoint& point : curve.points) {
      line["bars"].push_back(bar_of(point.mean[metric_iou], point.spread[metric_iou]));
      line["crossed"].push_back(point.fails);
    }
  }
  return out;
}

// This is what the first model, by which all is sorted, does not survive.
std::string verdict_of(const std::vector<StabilityResult>& results) {
  std::vector<std::string> fails;
  for (const auto& [axis, curves, baselines] : results)
    if (!curves.front().fails_at.empty())
      fails.push_back(axis.title + ", " + axis.kind() + " (" +
                      joined(curves.front().fails_at, ", ") + ")");
  const std::string name = name_in_charts(results.front().curves.front().name);
  if (fails.empty()) return name + " fails under none of the conditions that were tried.";
  constexpr std::size_t most = 5;
  const std::size_t more = fails.size() > most ? fails.size() - most : 0;
  fails.resize(fails.size() - more);
  return name + " fails with " + joined(fails, "; ") +
         (more > 0 ? formatted("; and with %zu others", more) : "") + ".";
}

}  // namespace

void write_stability_page(const StabilityOptions& o, const std::vector<StabilityResult>& results) {
  Json page =
      new_page("What fails first", verdict_of(results),
               formatted("%zu training records, %zu fresh ones to judge by, %zu seed%s, echofuse ",
                         o.records, o.test_records, o.seeds, o.seeds == 1 ? "" : "s") +
                   version() + ". Means of the seeds, bars: their spread.");
  std::vector<Json> panels;
  for (const StabilityResult& result : results) panels.push_back(panel_of(result));
  Json block = charts(panels);
  block["panels"] = true;
  add_section(
      page, "axes", "Where each model fails",
      Json::array(
          {paragraph("A cross: there the model fails, which the table defines; shaded: below the "
                     "best baseline by IoU. Matched: trained and tested under the condition. "
                     "Shifted: trained at the base condition, tested under this one. "
                     "Sorted by what breaks the first model most."),
           block}));
  add_section(
      page, "table", "All conditions",
      Json::array(
          {paragraph("A model fails where its map is no better than no map: its hard SSIM is "
                     "not above the empty room's, or its IoU is not above that of empty room "
                     "and mean map (by more than the spread over seeds), or there is no map at "
                     "all. Of single records that it cannot read it shows the empty room. Half: "
                     "its IoU falls below half of the base's."),
           table_of(results)}));
  write_atomically(o.out + "/stability.html", html_of(page));
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
