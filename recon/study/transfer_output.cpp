// SPDX-License-Identifier: MIT
// The table and the chart of a transfer study.
#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "drivers/chart/chart.hpp"
#include "drivers/chart/style.hpp"
#include "recon/files/text.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/study/transfer.hpp"

namespace echofuse::recon {
namespace {

struct Way {
  const char *from, *model, *name;
  int colour;
  bool dashed;
  double aside;  // points of one size stand side by side
};
// Where a model comes from by colour, what was done with the new records by the line.
constexpr std::array ways{Way{"none", "alone", "new records alone", chart::grey, false, 1},
                          Way{"base", "pooled", "base, pooled", chart::of_camera, true, 0.92},
                          Way{"base", "tuned", "base, tuned", chart::of_camera, false, 0.96},
                          Way{"twin", "pooled", "laboratories, pooled", chart::of_both, true, 1.04},
                          Way{"twin", "tuned", "laboratories, tuned", chart::of_both, false, 1.08}};

chart::Panel panel_of(const std::vector<TransferRow>& rows, std::size_t metric, double unit,
                      const std::string& title, const std::string& y) {
  chart::Panel panel{title, {"records of the new world", true}, {y}, {}};
  panel.width = 560, panel.height = 420;
  panel.note =
      "Points of one number of records stand side by side; bars: spread over draws. Base: on top "
      "of "
      "a model of one world; laboratories: of many. As it was: without any new record.";
  for (const Way& way : ways) {
    chart::Series line{way.name, {}, way.colour, chart::Look::both, way.dashed};
    for (const TransferRow& r : rows)
      if (r.from == way.from && r.model == way.model) {
        const double mean = unit * r.mean[metric], spread = unit * r.spread[metric];
        line.points.push_back(
            {way.aside * static_cast<double>(r.records), mean, mean - spread, mean + spread});
      }
    panel.series.push_back(line);
  }
  for (const TransferRow& r : rows)
    if (r.model == "as it was")
      panel.rules.push_back(
          {unit * r.mean[metric], (r.from == "twin" ? "laboratories" : r.from) + ", as it was"});
  return panel;
}

}  // namespace

std::vector<TransferRow> summarise_transfer(const std::vector<Measurement>& all) {
  std::vector<TransferRow> rows;
  std::vector<std::vector<const Measurement*>> of_row;
  for (const Measurement& m : all) {
    const auto records = static_cast<std::size_t>(std::stoul(m.value));
    const auto known = std::find_if(rows.begin(), rows.end(), [&](const TransferRow& r) {
      return r.from == m.axis && r.model == m.model && r.records == records;
    });
    const auto at = static_cast<std::size_t>(known - rows.begin());
    if (known == rows.end()) rows.push_back({m.axis, m.model, records}), of_row.emplace_back();
    of_row[at].push_back(&m);
  }
  for (std::size_t at = 0; at < rows.size(); ++at) {
    const auto values = [&](const std::string& name) {
      std::vector<double> out;
      for (const Measurement* m : of_row[at]) out.push_back(m->metric(name));
      return out;
    };
    rows[at].seeds = of_row[at].size();
    for (std::size_t i = 0; i < transfer_metrics.size(); ++i) {
      const auto found = values(metric_names[transfer_metrics[i]]);
      const auto n = static_cast<double>(found.size());
      rows[at].mean[i] = mean_of(found);
      rows[at].spread[i] =
          n > 1 ? standard_deviation(found) * std::sqrt(n / (n - 1)) : std::nan("");
    }
    rows[at].within_90 = mean_of(values("within_90"));
    std::set<std::string> machines;
    double sum = 0, timed = 0;
    for (const Measurement* m : of_row[at])
      if (!m->machine.empty()) machines.insert(m->machine), sum += m->metric("train_s"), ++timed;
    rows[at].train_s = sum / timed;
    for (const auto& name : machines)
      rows[at].machine += (rows[at].machine.empty() ? "" : "+") + name;
  }
  std::stable_sort(rows.begin(), rows.end(), [](const TransferRow& a, const TransferRow& b) {
    return a.records < b.records;
  });
  return rows;
}

std::string to_text(const std::vector<TransferRow>& rows) {
  std::string out = formatted("%7s %-5s %-33s %16s %16s %9s %9s %8s\n", "records", "from", "model",
                              "IoU", "lateral cm", "SSIM hard", "within 90", "train s");
  for (const TransferRow& r : rows)
    out += formatted("%7zu %-5s %-33s %8.3f +-%6.3f %8.1f +-%6.1f %9.3f %9.3f %8.1f\n", r.records,
                     r.from.c_str(), r.model.c_str(), r.mean[0], r.spread[0], 100 * r.mean[1],
                     100 * r.spread[1], r.mean[2], r.within_90, r.train_s);
  return out;
}

void write_transfer(const std::vector<TransferRow>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "from,model,records,seeds";
  for (const Metric m : transfer_metrics)
    csv << ',' << metric_names[m] << ',' << metric_names[m] << "_spread";
  csv << ",within_90,train_s,machine\n";
  for (const TransferRow& r : rows) {
    std::string model = r.model;
    std::replace(model.begin(), model.end(), ',', ';');
    csv << r.from << ',' << model << ',' << r.records << ',' << r.seeds;
    for (std::size_t i = 0; i < transfer_metrics.size(); ++i)
      csv << ',' << r.mean[i] << ',' << r.spread[i];
    csv << ',' << r.within_90 << ',' << r.train_s << ',' << r.machine << '\n';
  }
  chart::write_chart(folder, "transfer", csv.str(),
                     chart::stand_alone("From one world to another",
                                        {panel_of(rows, 0, 1, "IoU", "IoU"),
                                         panel_of(rows, 1, 100, "Place", "lateral error (cm)")},
                                        2));
}

}  // namespace echofuse::recon
