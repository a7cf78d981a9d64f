// SPDX-License-Identifier: MIT
// The table and the chart of a Pareto study.
#include <cstdlib>
#include <filesystem>
#include <map>
#include <sstream>

#include "drivers/chart/gnuplot.hpp"
#include "drivers/core/atomic_write.hpp"
#include "drivers/core/exit_code.hpp"
#include "recon/files/files.hpp"
#include "recon/files/text.hpp"
#include "recon/study/pareto.hpp"

namespace echofuse::recon {
namespace {

constexpr std::array shown = {metric_iou,    metric_ssim_fg,     metric_ssim_hard, metric_ssim,
                              metric_rmse_m, metric_depth_mae_m, metric_lateral_m, metric_ghost};

// Columns: 1 sweep, 2 share, 3 model, 4 seeds, then mean and spread of each metric from 5 on,
// then 21 multiply_adds, 22 us_median, 23 us_p99, 24 train_s, 25 front.
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

// A line of the table: its values by the header's names.
using Fields = std::map<std::string, std::string>;

std::vector<Fields> read_table(const std::string& path) {
  std::istringstream file(read_text(path));
  std::string line;
  std::getline(file, line);
  const auto names = cells_of(line);
  std::vector<Fields> rows;
  while (std::getline(file, line)) {
    const auto values = cells_of(line);
    if (values.size() != names.size())
      throw Error(ExitCode::failed,
                  path + formatted(":%zu: expected %zu values", rows.size() + 2, names.size()));
    rows.emplace_back();
    for (std::size_t i = 0; i < names.size(); ++i) rows.back()[names[i]] = values[i];
  }
  return rows;
}

double number(const Fields& row, const std::string& name, const std::string& path) {
  const auto found = row.find(name);
  char* end = nullptr;
  const double value = found == row.end() ? 0 : std::strtod(found->second.c_str(), &end);
  if (!end || *end != 0 || found->second.empty())
    throw Error(ExitCode::failed, path + ": expected a number as " + name);
  return value;
}

std::string spread_name(Metric m) { return metric_names[m] + std::string("_spread"); }

std::string to_csv(const std::vector<ParetoRow>& rows) {
  std::ostringstream csv;
  csv << "sweep,share,model,seeds";
  for (const Metric m : shown) csv << ',' << metric_names[m] << ',' << spread_name(m);
  csv << ",multiply_adds,infer_us_median,infer_us_p99,train_s,front\n";
  for (const ParetoRow& r : rows) {
    csv << r.sweep << ',' << r.share << ',' << r.model << ',' << r.seeds;
    for (const Metric m : shown) csv << ',' << r.mean[m] << ',' << r.spread[m];
    csv << ',' << r.cost.cost.multiply_adds << ',' << r.cost.infer_us_median << ','
        << r.cost.infer_us_p99 << ',' << r.cost.train_s << ',' << r.front << '\n';
  }
  return csv.str();
}

}  // namespace

std::vector<ParetoRow> read_pareto(const std::string& folder) {
  const std::string path = folder + "/pareto.csv";
  std::vector<ParetoRow> rows;
  if (!std::filesystem::exists(path)) return rows;
  for (const Fields& line : read_table(path)) {
    const auto value = [&](const std::string& name) { return number(line, name, path); };
    const auto count = [&](const std::string& name) {
      return static_cast<std::size_t>(value(name));
    };
    ParetoRow r;
    r.share = value("share");
    r.seeds = count("seeds");
    r.sweep = line.at("sweep");
    r.model = line.at("model");
    for (const Metric m : shown) {
      r.mean[m] = value(metric_names[m]);
      r.spread[m] = value(spread_name(m));
    }
    r.cost.cost.multiply_adds = count("multiply_adds");
    r.cost.infer_us_median = value("infer_us_median");
    r.cost.infer_us_p99 = value("infer_us_p99");
    r.cost.train_s = value("train_s");
    r.front = value("front") > 0;
    rows.push_back(std::move(r));
  }
  return rows;
}

void write_pareto_table(const std::vector<ParetoRow>& rows, const std::string& folder) {
  write_atomically(folder + "/pareto.csv", to_csv(rows));
}

LateralBound read_bound(const std::string& path) {
  LateralBound bound;
  for (const Fields& row : read_table(path)) {
    const auto is = [&](const char* name, const char* value) {
      const auto found = row.find(name);
      return found != row.end() && found->second == value;
    };
    if (!is("axis", "base")) continue;
    if (is("known", "shape")) bound.shape_known_m = number(row, "lateral_error_m", path);
    if (is("known", "pose")) bound.pose_unknown_m = number(row, "lateral_error_m", path);
  }
  if (!(bound.shape_known_m > 0 && bound.pose_unknown_m > 0))
    throw Error(ExitCode::failed, path + ": is not a bound.csv of `echofuse-sim study bound`");
  return bound;
}

// `@bound` of the chart is replaced by gnuplot.
void write_pareto(const std::vector<ParetoRow>& rows, const std::string& folder,
                  const std::optional<LateralBound>& bound) {
  const std::string lines = bound ? formatted(
                                        ", %g with lines dt 2 lc 2 title 'bound: pose unknown', "
                                        "%g with lines dt 3 lc 7 title 'bound: shape known'",
                                        bound->pose_unknown_m, bound->shape_known_m)
                                  : "";
  write_chart(folder, "pareto", to_csv(rows), "bound = \"" + lines + "\"\n" + chart);
}

std::string to_text(const std::vector<ParetoRow>& rows) {
  std::string out = formatted("%-8s %6s %-18s %15s %8s %9s %8s %8s %12s %8s %8s %8s\n", "sweep",
                              "share", "model", "IoU", "SSIM_fg", "SSIM hard", "lateral", "ghost",
                              "mult-adds", "us", "us p99", "train s");
  for (const ParetoRow& r : rows)
    out += formatted(
        "%-8s %6g %-18s %7.3f +-%6.3f %8.3f %9.3f %8.3f %8.4f %12zu %8.1f %8.1f %8.1f%s\n",
        r.sweep.c_str(), r.share, r.model.c_str(), r.mean[metric_iou], r.spread[metric_iou],
        r.mean[metric_ssim_fg], r.mean[metric_ssim_hard], r.mean[metric_lateral_m],
        r.mean[metric_ghost], r.cost.cost.multiply_adds, r.cost.infer_us_median,
        r.cost.infer_us_p99, r.cost.train_s, r.front ? "  front" : "");
  return out;
}

}  // namespace echofuse::recon
