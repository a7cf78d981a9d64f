// SPDX-License-Identifier: MIT
// The table and the chart of a Pareto study.
#include <sstream>

#include "drivers/chart/gnuplot.hpp"
#include "recon/files/text.hpp"
#include "recon/study/pareto.hpp"

namespace echofuse::recon {
namespace {

constexpr std::array shown = {metric_iou,    metric_ssim_fg,     metric_ssim_hard, metric_ssim,
                              metric_rmse_m, metric_depth_mae_m, metric_lateral_m, metric_ghost};

// Columns: 1 sweep, 2 share, 3 model, 4 seeds, then mean and spread of each metric from 5 on,
// then 21 multiply_adds, 22 us_median, 23 us_p99, 24 train_s, 25 front,
// 26 machine.
constexpr const char* chart = R"(set datafile separator ','
set datafile missing 'nan'
set terminal svg size 1100,800 font 'sans,12' background 'white'
set output 'pareto.svg'
set multiplot layout 2,2
set logscale x; set grid; set key left center
iou(what) = strcol(1) eq what ? $5 : NaN
set title 'accuracy against the time of one map'
set xlabel 'one map on one thread, us (median)'; set ylabel 'IoU of the foreground'
set yrange [-0.02:0.8]; set xrange [1:3000]
plot "< awk -F, '$1==\"model\" && $25==1' pareto.csv | sort -t, -k22,22g" using 22:5 with steps lw 2 lc 'gray' title 'Pareto front', \
     'pareto.csv' using 22:(iou('model')):6 with yerrorbars pt 7 ps 0.6 lc 3 notitle, \
     '' using 22:(iou('model')):3 with labels left font ',9' offset 0.6,0.5 rotate by 25 notitle, \
     '' using 22:(strcol(3) eq 'mlp-512-256' ? iou('model') : NaN) with points pt 6 ps 2 lc 7 title "the paper's network"
set title 'position against multiply-adds'; set key top left
set xlabel 'multiply-adds of one map'; set ylabel 'lateral error, m'; set logscale y; set yrange [0.01:1]; set xrange [1e4:1e7]
plot 'pareto.csv' using 21:(strcol(1) eq 'model' ? $17 : NaN) with points pt 7 lc 3 notitle, \
     '' using 21:(strcol(1) eq 'model' ? $17 : NaN):3 with labels left font ',9' offset 0.6,0.5 rotate by 25 notitle @bound
unset logscale y; set yrange [-0.02:0.7]; set ylabel 'IoU of the foreground'; set key bottom right; set xrange [*:*]
models = system("awk -F, '$1==\"photons\"||$1==\"records\"{print $3}' pareto.csv | sort -u")
part(what, model) = sprintf("< awk -F, '($1==\"%s\" || $1==\"model\") && $3==\"%s\"' pareto.csv | sort -t, -k2,2g", what, model)
if (words(models) > 0) {
  set title 'exposure'; set xlabel "share of the record's photons"
  plot for [m in models] part('photons', m) using 2:5 with linespoints pt 7 title m
  set title 'training records'; set xlabel 'share of the training records'
  plot for [m in models] part('records', m) using 2:5 with linespoints pt 7 title m
}
)";

std::string to_csv(const std::vector<ParetoRow>& rows) {
  std::ostringstream csv;
  csv << "sweep,share,model,seeds";
  for (const Metric m : shown) csv << ',' << metric_names[m] << ',' << metric_names[m] << "_spread";
  csv << ",multiply_adds,infer_us_median,infer_us_p99,train_s,front,machine\n";
  for (const ParetoRow& r : rows) {
    csv << r.sweep << ',' << r.share << ',' << r.model << ',' << r.seeds;
    for (const Metric m : shown) csv << ',' << r.mean[m] << ',' << r.spread[m];
    csv << formatted(",%.0f,", r.multiply_adds) << r.infer_us_median << ',' << r.infer_us_p99 << ','
        << r.train_s << ',' << r.front << ',' << r.machine << '\n';
  }
  return csv.str();
}

}  // namespace

// `@bound` of the chart is replaced by gnuplot.
void write_pareto(const std::vector<ParetoRow>& rows, const std::string& folder,
                  const std::vector<double>& bound) {
  std::string lines;
  if (!bound.empty())
    lines = formatted(
        ", %g with lines dt 2 lc 2 title 'bound: pose unknown', "
        "%g with lines dt 3 lc 7 title 'bound: shape known'",
        bound[0], bound[1]);
  write_chart(folder, "pareto", to_csv(rows), "bound = \"" + lines + "\"\n" + chart);
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
