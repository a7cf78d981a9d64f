// SPDX-License-Identifier: MIT
// The table and the chart of a transfer study.
#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>

#include "drivers/chart/gnuplot.hpp"
#include "recon/files/text.hpp"
#include "recon/numbers/statistics.hpp"
#include "recon/study/transfer.hpp"

namespace echofuse::recon {
namespace {

// Columns: 1 from, 2 model, 3 records, 4 seeds, then mean and spread of IoU, lateral error and hard
// SSIM from 5 on, then 11 within_90, 12 train_s, 13 machine.
constexpr const char* chart = R"(set datafile separator ','
set terminal svg size 1100,460 font 'sans,12' background 'white'
set output 'transfer.svg'
set multiplot layout 1,2
set logscale x; set grid; set xlabel 'records of the new world'; set xrange [8:1200]
what = "none/alone base/pooled base/tuned twin/pooled twin/tuned"
part(w) = sprintf("< grep '^%s,' transfer.csv | sort -t, -k3,3g", system("echo '".w."' | tr / ,"))
was(from, column) = real(system(sprintf("grep '^%s,as it was,' transfer.csv | cut -d, -f%d", from, column)))
set key bottom right; set ylabel 'IoU of the foreground'
plot for [w in what] part(w) using 3:5:($6==$6?$6:0) with yerrorlines pt 7 ps 0.6 title w, \
     was('base', 5) dt 2 lc 2 title 'base/as it was', was('twin', 5) dt 2 lc 4 title 'twin/as it was'
set key top right; set ylabel 'lateral error, cm'
plot for [w in what] part(w) using 3:(100*$7):($8==$8?100*$8:0) with yerrorlines pt 7 ps 0.6 title w, \
     100*was('base', 7) dt 2 lc 2 notitle, 100*was('twin', 7) dt 2 lc 4 notitle
)";

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
  write_chart(folder, "transfer", csv.str(), chart);
}

}  // namespace echofuse::recon
