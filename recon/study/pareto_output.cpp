// SPDX-License-Identifier: MIT
// The page and the text of a Pareto study.
#include <algorithm>

#include "drivers/program/console.hpp"
#include "drivers/program/new_file.hpp"
#include "recon/numbers/text.hpp"
#include "recon/study/pareto.hpp"
#include "recon/study/study_page.hpp"

namespace echofuse::recon {
namespace {

using Models = std::vector<ParetoRow>;

constexpr const char* papers_network = "mlp-512-256";

// Of an IoU of 0 there is no body to be seen: such models would only press the others together.
bool is_shown(const ParetoRow& r) { return r.sweep == "model" && r.mean[metric_iou] >= 0.01; }

// A point a model, with its name and the spread over seeds.
Json models_chart(const Models& rows, Json out, Metric metric, double unit,
                  double ParetoRow::*cost) {
  for (const ParetoRow& r : rows) {
    if (!is_shown(r) || !(r.*cost > 0)) continue;
    const double mean = unit * r.mean[metric];
    Json& one = add_series(out, r.model, colour_of_model(r.model), Look::points,
                           std::vector<std::pair<double, double>>{{r.*cost, mean}});
    one["bars"] = Json::array({bar_of(mean, unit * r.spread[metric])});
    one["names"] = {name_in_charts(r.model) +
                    (r.model == papers_network ? ", the paper's network" : "")};
  }
  out["log_x"] = true, out["height"] = 460;
  return out;
}

// This is what no model is both faster and better than, from fast to slow.
Models front_of(const Models& rows) {
  Models front;
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(front),
               [](const ParetoRow& r) { return r.front && is_shown(r); });
  std::sort(front.begin(), front.end(),
            [](const auto& a, const auto& b) { return a.infer_us_median < b.infer_us_median; });
  return front;
}

Json time_chart(const Models& rows) {
  Json out = models_chart(rows,
                          chart("Outline against the time of a map; the line is the Pareto front",
                                "time of one map on one thread (\u00b5s, median)", "IoU"),
                          metric_iou, 1, &ParetoRow::infer_us_median);
  std::vector<std::pair<double, double>> line;
  for (const ParetoRow& r : front_of(rows))
    line.emplace_back(r.infer_us_median, r.mean[metric_iou]);
  add_series(out, "", "grey", Look::steps, line);
  std::string hidden;
  for (const ParetoRow& r : rows)
    if (r.sweep == "model" && !is_shown(r))
      hidden += (hidden.empty() ? "" : "; ") + name_in_charts(r.model);
  const std::size_t seeds = rows.front().seeds;
  out["note"] = (seeds > 1 ? formatted("Bars: spread over %zu seeds.", seeds)
                           : std::string("One seed: no bars.")) +
                (hidden.empty() ? "" : " Not shown, IoU 0: " + hidden + ".");
  return out;
}

Json place_chart(const Models& rows, const std::vector<double>& bound) {
  Json out = models_chart(
      rows,
      chart("Place against the cost of a map", "multiply-adds of one map", "lateral error (cm)"),
      metric_lateral_m, 100, &ParetoRow::multiply_adds);
  out["log"] = true;
  const auto rule = [&](double at_m, const char* name) {
    add_rule(out, 100 * at_m, formatted("%s: %g cm", name, 100 * at_m));
    out["rules"].back()["across"] = true;
  };
  if (bound.size() == 2 && bound[0] == bound[1]) {
    rule(bound[0], "least possible (Cram\u00e9r-Rao)");
  } else if (bound.size() == 2) {
    rule(bound[0], "least possible");
    rule(bound[1], "with known shape");
  }
  return out;
}

// IoU against the share of photons or of training records, a line a model; null if there is none.
Json sweep_chart(const Models& rows, const std::string& sweep) {
  const bool photons = sweep == "photons";
  Json out =
      chart(photons ? "Fewer photons" : "Fewer training records",
            photons ? "share of the record's photons" : "share of the training records", "IoU");
  ModelColours colours;
  std::vector<std::string> models;
  for (const ParetoRow& r : rows)
    if (r.sweep == sweep && std::ranges::count(models, r.model) == 0) models.push_back(r.model);
  for (const std::string& model : models) {
    Models points;
    for (const ParetoRow& r : rows)
      if (r.model == model && (r.sweep == sweep || r.sweep == "model")) points.push_back(r);
    std::sort(points.begin(), points.end(),
              [](const auto& a, const auto& b) { return std::stod(a.share) < std::stod(b.share); });
    std::vector<std::pair<double, double>> line;
    Json bars = Json::array();
    for (const ParetoRow& r : points) {
      line.emplace_back(std::stod(r.share), r.mean[metric_iou]);
      bars.push_back(bar_of(r.mean[metric_iou], r.spread[metric_iou]));
    }
    add_series(out, name_in_charts(model), colours.of(model), Look::marked, line)["bars"] = bars;
  }
  out["log_x"] = true;
  return models.empty() ? Json() : out;
}

Json table_of(const Models& rows) {
  const Json head{words("model"),  words("sweep"),   "share",         "IoU",
                  "SSIM, body",    "SSIM, hard map", "lateral (cm)",  "ghost",
                  "multiply-adds", "\u00b5s",        "\u00b5s, 99 %", "training (s)"};
  Json body = Json::array();
  const auto time = [](double value) {
    return std::isnan(value) ? std::string("\u2013") : three_digits(value);
  };
  const auto number = [](const char* format, double value) {
    return std::isnan(value) ? std::string("\u2013") : formatted(format, value);
  };
  for (const ParetoRow& r : rows)
    body.push_back({cell(name_in_charts(r.model), r.front ? "on the front" : ""), r.sweep, r.share,
                    cell(formatted("%.3f", r.mean[metric_iou]),
                         r.seeds > 1 ? formatted("\u00b1%.3f", r.spread[metric_iou]) : ""),
                    formatted("%.3f", r.mean[metric_ssim_fg]),
                    formatted("%.3f", r.mean[metric_ssim_hard]),
                    number("%.1f", 100 * r.mean[metric_lateral_m]),
                    number("%.3f", r.mean[metric_ghost]), three_digits(r.multiply_adds),
                    time(r.infer_us_median), time(r.infer_us_p99), time(r.train_s)});
  return table("Means over the seeds; all measurements: pareto.csv", head, body);
}

std::string verdict_of(const Models& rows) {
  const Models front = front_of(rows);
  if (front.empty()) return "No model draws a body.";
  std::string out = "Worth their time: ";
  for (const ParetoRow& r : front)
    out += formatted("%s%s (IoU %.2f in %s \u00b5s)", &r == &front.front() ? "" : ", ",
                     name_in_charts(r.model).c_str(), r.mean[metric_iou],
                     three_digits(r.infer_us_median).c_str());
  return out + ". No other model is as good and as fast as one of these.";
}

}  // namespace

void write_pareto_page(const Models& rows, const std::string& folder,
                       const std::vector<double>& bound) {
  Json page =
      new_page("Accuracy against cost", verdict_of(rows), formatted("echofuse %s.", version()));
  add_section(page, "front", "The front",
              Json::array({charts({time_chart(rows), place_chart(rows, bound)})}));
  std::vector<Json> sweeps;
  for (const char* sweep : {"photons", "records"})
    if (Json one = sweep_chart(rows, sweep); !one.is_null()) sweeps.push_back(std::move(one));
  if (!sweeps.empty()) add_section(page, "less", "With less", Json::array({charts(sweeps)}));
  add_section(page, "table", "Numbers", Json::array({table_of(rows)}));
  write_atomically(folder + "/pareto.html", html_of(page));
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
