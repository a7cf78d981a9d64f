// SPDX-License-Identifier: MIT
// This file writes the table and the chart of the bound.
#include <algorithm>
#include <sstream>

#include "drivers/chart/chart.hpp"
#include "drivers/chart/style.hpp"
#include "sim/study/bound.hpp"

namespace echofuse::sim {
namespace {

struct BoundAxis {
  const char *name, *title;
  bool log;
};
constexpr BoundAxis axes[] = {{"photons", "photons a record", true},
                              {"baseline_m", "baseline (m)", true},
                              {"resolution_m", "radar's resolution (m)", true},
                              {"snr_db", "radar's SNR (dB)", false}};

// It shows medians, with quartiles as bars, in cm.
chart::Panel panel_of(const std::vector<Bound>& rows, const BoundAxis& axis) {
  chart::Panel panel{"", {axis.title, axis.log}, {"standard deviation of x (cm)", true}, {}};
  panel.width = 500, panel.height = 300;
  for (const char* known : {"shape", "pose"}) {
    const bool shape = known == std::string("shape");
    chart::Series line{
        shape ? "shape known" : "pose unknown", {}, shape ? chart::grey : chart::of_both};
    for (const Bound& r : rows)
      if (r.axis == axis.name && r.known == known)
        line.points.push_back({r.value, 100 * r.x_median_m, 100 * r.x_lower_m, 100 * r.x_upper_m});
    std::sort(line.points.begin(), line.points.end(),
              [](const auto& a, const auto& b) { return a.x < b.x; });
    panel.series.push_back(line);
  }
  return panel;
}

}  // namespace

void write_bound(const std::vector<Bound>& rows, const std::string& folder) {
  std::ostringstream csv;
  csv << "axis,value,known,x_median_m,x_lower_m,x_upper_m,x_error_m,lateral_error_m\n";
  for (const Bound& r : rows)
    csv << r.axis << ',' << r.value << ',' << r.known << ',' << r.x_median_m << ',' << r.x_lower_m
        << ',' << r.x_upper_m << ',' << r.x_error_m << ',' << r.lateral_error_m << '\n';
  std::vector<chart::Panel> panels;
  for (const BoundAxis& axis : axes) panels.push_back(panel_of(rows, axis));
  chart::write_chart(folder, "bound", csv.str(),
                     chart::stand_alone("Least error of the lateral position (Cram\u00e9r-Rao); "
                                        "bars: quartiles over scenes",
                                        panels, 2));
}

}  // namespace echofuse::sim
