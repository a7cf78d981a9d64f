// SPDX-License-Identifier: MIT
// The table and the chart of the bound.
#include <sstream>

#include "drivers/chart/gnuplot.hpp"
#include "sim/study/bound.hpp"

namespace echofuse::sim {
namespace {

// Columns: 1 axis, 2 value, 3 known, 4 median, 5 and 6 quartiles, 7 error of x, 8 of the centroid.
constexpr const char* chart = R"(set datafile separator ','
set terminal svg size 1000,720 font 'sans,12' background 'white'
set output 'bound.svg'
set multiplot layout 2,2 title 'least error of the lateral position (Cramer-Rao)'
set logscale xy; set grid; set key top right; set offsets graph 0.05, graph 0.05
set ylabel 'standard deviation of x, m'; set yrange [0.001:1]
axis(what, known) = sprintf("< awk -F, '$1==\"%s\" && $3==\"%s\"' bound.csv", what, known)
what(known) = known eq 'shape' ? 'shape known' : 'pose unknown'
do for [a in 'photons baseline_m resolution_m snr_db'] {
  if (a eq 'snr_db') { unset logscale x }
  set xlabel a eq 'photons' ? 'photons a record' : a eq 'baseline_m' ? 'baseline, m' : \
             a eq 'resolution_m' ? 'radar resolution, m' : 'radar SNR, dB'
  plot for [k in 'shape pose'] axis(a, k) using 2:4:5:6 with yerrorlines pt 7 ps 0.6 \
       title what(k).' (median, quartiles)'
}
)";

}  // namespace

void write_bound(const std::vector<Bound>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "axis,value,known,x_median_m,x_lower_m,x_upper_m,x_error_m,lateral_error_m\n";
  for (const Bound& r : rows)
    csv << r.axis << ',' << r.value << ',' << r.known << ',' << r.x_median_m << ',' << r.x_lower_m
        << ',' << r.x_upper_m << ',' << r.x_error_m << ',' << r.lateral_error_m << '\n';
  write_chart(folder, "bound", csv.str(), chart);
}

}  // namespace echofuse::sim
