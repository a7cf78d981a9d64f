// SPDX-License-Identifier: MIT
// Records as a report shows them.
#include <algorithm>
#include <cmath>
#include <utility>

#include "drivers/chart/style.hpp"
#include "recon/estimator/predict.hpp"
#include "recon/files/text.hpp"
#include "recon/output/report.hpp"

namespace echofuse::recon {
namespace {

chart::Panel histogram(const Dataset& data, std::size_t row) {
  chart::Panel out{"SPD: clicks by range",
                   {"range (m)"},
                   {"clicks a bin", false, 0},
                   {{"", {}, chart::of_spd, chart::Look::steps}}};
  const auto counts = data.spd.row(row);
  for (std::size_t i = 0; i < counts.size(); ++i)
    out.series[0].points.push_back(
        {data.spd_axis.at(static_cast<double>(i) + 0.5) / ps_per_m, double{counts[i]}});
  return out;
}

chart::Panel profile(const Dataset& data, std::size_t row) {
  constexpr double least_db = -40;
  chart::Panel out{"Radar: power by range",
                   {"range (m)"},
                   {"power (dB, 0: the strongest bin)"},
                   {{"", {}, chart::of_radar, chart::Look::line}}};
  out.y.first = least_db, out.y.last = 2;
  const auto power = data.radar.row(row);
  const double most = power.empty() ? 0 : double{*std::max_element(power.begin(), power.end())};
  for (std::size_t i = 0; i < power.size(); ++i) {
    const double db = 10 * std::log10(std::max(double{power[i]} / std::max(most, 1e-300), 1e-300));
    out.series[0].points.push_back(
        {data.radar_axis.at(static_cast<double>(i)), db < least_db ? chart::nan : db});
  }
  out.note = formatted("Bins of %.2g m; a gap: below %g dB.", data.radar_axis.step, least_db);
  return out;
}

// One axis for both sensors, as wide as the detector's, and where the camera sees the body.
void share_ranges(std::vector<chart::Panel>& panels, std::span<const float> truth,
                  const Scene& scene) {
  double last = 0, range = 0, pixels = 0;
  for (const auto& point : panels.front().series[0].points) last = std::max(last, point.x);
  for (std::size_t p = 0; p < truth.size(); ++p)
    if (true_foreground(truth[p], scene.background[p])) range += double{truth[p]}, ++pixels;
  for (chart::Panel& panel : panels) {
    panel.x.first = 0;
    if (last > 0) panel.x.last = std::ceil(last);
    if (pixels > 0) panel.rules.push_back({range / pixels, "body (camera)", true});
  }
}

void state(ShownMap& out, const PredictionUncertainty& stated) {
  out.stated =
      std::isnan(stated.lateral_interval_90_m)
          ? "the place is not known"
          : formatted("within %.0f cm sideways (90 %%)", 100 * stated.lateral_interval_90_m);
  if (!stated.out_of_distribution.reason.empty())
    out.warning = "unlike the training: " + stated.out_of_distribution.text();
}

}  // namespace

ShownRecord show_record(const std::vector<const TrainedModel*>& models,
                        const std::vector<std::string>& names, const Dataset& data,
                        std::size_t row) {
  ShownRecord out;
  const auto truth = data.depth.row(row);
  out.truth.assign(truth.begin(), truth.end());
  out.title =
      formatted("%s, record %lld", data.label[row].empty() ? "no label" : data.label[row].c_str(),
                static_cast<long long>(data.index[row]));
  out.half_tangent = data.map.half_tangent;
  out.measured = {histogram(data, row), profile(data, row)};
  share_ranges(out.measured, truth, models.front()->first().scene);
  for (std::size_t i = 0; i < models.size(); ++i) {
    const TrainedModel& model = *models[i];
    const Records seen = prepare_records(model, part_of(data, {row}));
    const Prediction made = predict(
        model, seen, {0}, model->uncertainty ? PredictionDetail::pixels : PredictionDetail::maps);
    ShownMap map{names[i],
                 hard_map(within_span(made.maps.row(0)), model->scene),
                 {},
                 foreground_share(made.maps.row(0), model->scene),
                 score(made.maps.row(0), truth, model->scene),
                 {},
                 {}};
    if (model->uncertainty) {
      const auto deviation = std::as_const(made.deviation).row(0);
      map.deviation.assign(deviation.begin(), deviation.end());
      state(map, made.uncertainties.front());
    } else {
      map.stated = "no uncertainty (too few training records)";
    }
    out.maps.push_back(std::move(map));
  }
  return out;
}

}  // namespace echofuse::recon
