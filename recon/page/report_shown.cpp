// SPDX-License-Identifier: MIT
// Records as a report shows them.
#include <algorithm>
#include <cmath>
#include <utility>

#include "recon/numbers/text.hpp"
#include "recon/page/report_page.hpp"
#include "recon/use/predict.hpp"

namespace echofuse::recon {
namespace {

// This is where the camera sees the body.
double body_range_m(std::span<const float> truth, const Scene& scene) {
  double range = 0, pixels = 0;
  for (std::size_t p = 0; p < truth.size(); ++p)
    if (true_foreground(truth[p], scene.background[p])) range += double{truth[p]}, ++pixels;
  return range / pixels;
}

std::string scores_of(const ShownMap& m) {
  std::string out = formatted("IoU %.2f", m.scores[metric_iou]);
  if (!std::isnan(m.scores[metric_lateral_m]))
    out += formatted(", lateral error %.1f cm", 100 * m.scores[metric_lateral_m]);
  if (!std::isnan(m.scores[metric_depth_mae_m]))
    out += formatted(", depth error %.1f cm", 100 * m.scores[metric_depth_mae_m]);
  return out + ".";
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
                        const std::vector<std::string>& names, const Dataset& data, std::size_t row,
                        const Scene& judge) {
  ShownRecord out;
  const auto truth = data.depth.row(row);
  out.truth.assign(truth.begin(), truth.end());
  out.title =
      formatted("%s, record %lld", data.label[row].empty() ? "no label" : data.label[row].c_str(),
                static_cast<long long>(data.index[row]));
  out.half_tangent = data.map.half_tangent;
  out.spd_axis = data.spd_axis, out.radar_axis = data.radar_axis;
  if (data.has(row, Sensor::spd)) {
    const auto clicks = data.spd.row(row);
    out.clicks.assign(clicks.begin(), clicks.end());
  }
  if (data.has(row, Sensor::radar)) {
    const auto power = data.radar.row(row);
    out.power.assign(power.begin(), power.end());
  }
  out.body_m = body_range_m(truth, judge);
  for (std::size_t i = 0; i < models.size(); ++i) {
    const TrainedModel& model = *models[i];
    const Records seen = prepare_records(model, part_of(data, {row}));
    const Prediction made = predict(
        model, seen, {0}, model->uncertainty ? PredictionDetail::pixels : PredictionDetail::maps);
    ShownMap map{names[i],
                 hard_map(within_span(made.maps.row(0), judge), judge),
                 {},
                 foreground_share(made.maps.row(0), judge),
                 score(made.maps.row(0), truth, judge),
                 {},
                 {}};
    if (!made.uncertainties.empty()) {
      const auto deviation = std::as_const(made.deviation).row(0);
      map.deviation.assign(deviation.begin(), deviation.end());
      state(map, made.uncertainties.front());
    } else {
      map.stated = std::string("no uncertainty: ") + why_not_calibrated;
    }
    out.maps.push_back(std::move(map));
  }
  return out;
}

Json json_of(const ShownRecord& r) {
  const auto axis = [](const Axis& a) {
    return Json{{"start", a.start}, {"step", a.step}, {"count", a.count}};
  };
  Json out{{"title", r.title},
           {"half_tangent", r.half_tangent},
           {"truth", packed16(r.truth, 1e-3)},
           {"body_m", short_number(r.body_m)},
           {"spd", axis(r.spd_axis)},
           {"radar", axis(r.radar_axis)}};
  for (const float clicks : r.clicks) out["spd"]["clicks"].push_back(short_number(double{clicks}));
  for (const float power : r.power)
    out["radar"]["db"].push_back(short_number(10 * std::log10(std::max(double{power}, 1e-30))));
  for (const ShownMap& m : r.maps) {
    Json map{{"name", m.name},
             {"map", packed16(m.map, 1e-3)},
             {"share", packed8(m.share, 0.005)},
             {"scores", scores_of(m)},
             {"stated", m.stated}};
    if (!m.deviation.empty()) map["deviation"] = packed8(m.deviation, 0.01);
    out["maps"].push_back(map);
  }
  return out;
}

std::string words_of(const ShownMap& m, bool named) {
  std::string out;
  const std::string who = named ? m.name : "The model";
  if (!m.stated.empty()) out += who + " states: " + m.stated + ". ";
  if (!m.warning.empty()) out += who + " warns: " + m.warning + ". ";
  return out;
}

}  // namespace echofuse::recon
