// SPDX-License-Identifier: MIT
// The chart and the text of a Pareto study.
#include <algorithm>

#include "drivers/chart/chart.hpp"
#include "drivers/chart/style.hpp"
#include "drivers/program/atomic_write.hpp"
#include "recon/numbers/text.hpp"
#include "recon/study/model_colours.hpp"
#include "recon/study/pareto.hpp"

namespace echofuse::recon {
namespace {

constexpr const char* papers_network = "mlp-512-256";

// Mean and spread; without one of a single seed.
chart::Point point_of(const ParetoRow& r, double x, Metric metric, double unit = 1) {
  const double mean = r.mean[metric] * unit, spread = r.spread[metric] * unit;
  return {x, mean, mean - spread, mean + spread};
}

// Of an IoU of 0 there is no body to be seen: such models would only press the others together.
bool draws_a_body(const ParetoRow& r) { return r.mean[metric_iou] >= 0.01; }

std::string without_a_body(const std::vector<ParetoRow>& rows) {
  std::string out;
  for (const ParetoRow& r : rows)
    if (r.sweep == "model" && !draws_a_body(r))
      out += (out.empty() ? "" : "; ") + name_in_charts(r.model);
  return out.empty() ? out : " Not shown, IoU 0: " + out + ".";
}

// A point a model, with its name.
void add_models(chart::Panel& panel, const std::vector<ParetoRow>& rows, Metric metric, double unit,
                double ParetoRow::*cost) {
  std::size_t seeds = 0;
  for (const ParetoRow& r : rows) {
    if (r.sweep != "model" || !(r.*cost > 0) || !draws_a_body(r)) continue;
    const bool papers = r.model == papers_network;
    const int colour = papers                              ? chart::of_paper
                       : r.model.ends_with(":spd")         ? chart::of_spd
                       : r.model.ends_with(":radar")       ? chart::of_radar
                       : r.model.starts_with("factorised") ? chart::of_both
                                                           : chart::grey;
    chart::Series one{"", {point_of(r, r.*cost, metric, unit)}, colour, chart::Look::markers};
    one.points[0].label = name_in_charts(r.model) + (papers ? ", the paper's network" : "");
    panel.series.push_back(one);
    seeds = std::max(seeds, r.seeds);
  }
  panel.note =
      (seeds > 1 ? formatted("Bars: spread over %zu seeds, mostly within the marker.", seeds)
                 : std::string("One seed: no bars.")) +
      without_a_body(rows);
}

// What no model is both faster and better than.
chart::Series front_of(const std::vector<ParetoRow>& rows) {
  chart::Series front{"", {}, chart::grey, chart::Look::steps};
  for (const ParetoRow& r : rows)
    if (r.front && draws_a_body(r)) front.points.push_back({r.infer_us_median, r.mean[metric_iou]});
  std::sort(front.points.begin(), front.points.end(),
            [](const auto& a, const auto& b) { return a.x < b.x; });
  return front;
}

// IoU against the share of photons or of training records, a line a model.
chart::Panel sweep_panel(const std::vector<ParetoRow>& rows, const std::string& sweep) {
  const bool photons = sweep == "photons";
  const std::string what =
      photons ? "share of the record's photons" : "share of the training records";
  chart::Panel panel{
      photons ? "Fewer photons" : "Fewer training records", {what, true}, {"IoU"}, {}};
  for (const ParetoRow& r : rows) {
    if (r.sweep != sweep && r.sweep != "model") continue;
    const auto known = std::find_if(panel.series.begin(), panel.series.end(),
                                    [&](const auto& s) { return s.name == r.model; });
    if (known != panel.series.end())
      known->points.push_back(point_of(r, std::stod(r.share), metric_iou));
    else
      panel.series.push_back({r.model, {point_of(r, std::stod(r.share), metric_iou)}});
  }
  std::erase_if(panel.series, [](const auto& s) { return s.points.size() < 2; });
  ModelColours colours;
  for (auto& s : panel.series) {
    s.colour = colours.of(s.name);
    s.name = name_in_charts(s.name);
    std::sort(s.points.begin(), s.points.end(),
              [](const auto& a, const auto& b) { return a.x < b.x; });
  }
  return panel;
}

std::vector<chart::Panel> panels_of(const std::vector<ParetoRow>& rows,
                                    const std::vector<double>& bound) {
  constexpr double width = 560, height = 400;
  chart::Panel time{"Outline against the time of a map; the line is the Pareto front",
                    {"time of one map on one thread (\u00b5s, median)", true},
                    {"IoU"},
                    {front_of(rows)},
                    {},
                    {},
                    width,
                    height};
  add_models(time, rows, metric_iou, 1, &ParetoRow::infer_us_median);
  chart::Panel place{"Place against the cost of a map",
                     {"multiply-adds of one map", true},
                     {"lateral error (cm)", true},
                     {},
                     {},
                     {},
                     width,
                     height};
  if (!bound.empty())
    place.rules = {{100 * bound[0], formatted("least possible: %g cm", 100 * bound[0])},
                   {100 * bound[1], formatted("with known shape: %g cm", 100 * bound[1])}};
  if (bound.size() == 2 && bound[0] == bound[1])
    place.rules = {
        {100 * bound[0], formatted("least possible (Cram\u00e9r-Rao): %g cm", 100 * bound[0])}};
  add_models(place, rows, metric_lateral_m, 100, &ParetoRow::multiply_adds);
  std::vector<chart::Panel> out{time, place};
  for (const char* sweep : {"photons", "records"}) {
    chart::Panel panel = sweep_panel(rows, sweep);
    panel.width = width;
    if (!panel.series.empty()) out.push_back(panel);
  }
  return out;
}

}  // namespace

void draw_pareto(const std::vector<ParetoRow>& rows, const std::string& folder,
                 const std::vector<double>& bound) {
  write_atomically(folder + "/pareto.svg",
                   chart::stand_alone("Accuracy against cost", panels_of(rows, bound), 2));
}

std::string to_text(const std::vector<ParetoRow>& rows) {
  std::string out = formatted("%-8s %6s %-18s %15s %8s %9s %8s %8s %12s %8s %8s %8s\n", "sweep",
                              "share", "model", "IoU", "SSIM_fg", "SSIM hard", "lateral", "ghost",
                              "mult-adds", "us", "us p99", "train s");
  for (const ParetoRow& r : rows)
    out += formatted(
        "%-8s %6s %-18s %7.3f +-%6.3f %8.3f %9.3f %8.3f %8.4f %12.0f %8.1f %8.1f %8.1f%s\n",
        r.sweep.c_str(), r.share.c_str(), r.model.c_str(), r.mean[metric_iou], r.spread[metric_iou],
        r.mean[metric_ssim_fg], r.mean[metric_ssim_hard], r.mean[metric_lateral_m],
        r.mean[metric_ghost], r.multiply_adds, r.infer_us_median, r.infer_us_p99, r.train_s,
        r.front ? "  front" : "");
  return out;
}

}  // namespace echofuse::recon
