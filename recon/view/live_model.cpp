// SPDX-License-Identifier: MIT
#include "recon/view/live_model.hpp"

#include <cmath>
#include <filesystem>

#include "drivers/program/printable.hpp"
#include "recon/metrics/metrics.hpp"
#include "recon/use/predict.hpp"

namespace echofuse::view {
namespace {

using namespace recon;

Reconstruction made(const TrainedModel& whole, const record::RunReader& run, std::int64_t index) {
  Reconstruction out;
  out.grid = whole->scene.grid;
  std::string bad;
  Dataset data = load_part(run, index, 1, sensors_of(whole->features.inputs),
                           [&](std::int64_t at, const std::string& why) {
                             if (at == index) bad = why;
                           });
  if (data.size() == 0 || data.index[0] != index) {
    out.fault = bad.empty() ? "cannot read the record" : bad;
    return out;
  }
  out.fault = whole.fault_of(data, 0);
  if (!out.fault.empty()) return out;
  const Records records = prepare_records(whole, std::move(data));
  out.fault = whole.fault_of(records.data, 0);
  if (!out.fault.empty()) return out;
  out.note = whole.note_of(records.data, 0);
  const bool states = whole->uncertainty.has_value();
  const Prediction p =
      predict(whole, records.data, {0}, states ? PredictionDetail::pixels : PredictionDetail::maps);
  if (const BodyPlace at = body_place(p.maps.row(0), whole->scene); std::isfinite(at.x_m))
    out.x_m = at.x_m, out.z_m = at.z_m;
  out.map_m = thresholded_map(p.maps.row(0), whole->scene);
  if (p.deviation.rows > 0 && !p.uncertainties.empty()) {
    const auto deviation = p.deviation.row(0);
    out.deviation_m.assign(deviation.begin(), deviation.end());
  }
  if (p.uncertainties.empty()) return out;
  const PredictionUncertainty& u = p.uncertainties[0];
  if (std::isfinite(u.lateral_interval_90_m)) out.lateral_interval_90_m = u.lateral_interval_90_m;
  if (const std::string more = u.out_of_distribution.text(); !more.empty())
    out.note += (out.note.empty() ? "" : "; ") + more;
  return out;
}

}  // namespace

LiveModel::LiveModel(const std::string& path)
    : model_(load_model(path)),
      name_(printable(std::filesystem::path(path).filename().string()) + " (" + model_->name +
            ")") {}

Reconstruction LiveModel::reconstruct(const record::RunReader& run, std::int64_t index) const {
  try {
    return made(model_, run, index);
  } catch (const Error& e) {
    Reconstruction out;
    out.fault = e.what();
    return out;
  }
}

bool LiveModel::saw(const std::string& run_uuid, std::int64_t index) const {
  const SeenRecords& seen = model_.seen;
  for (std::size_t i = 0; i < seen.index.size(); ++i)
    if (seen.index[i] == index && seen.runs[seen.run[i]] == run_uuid)
      return static_cast<Part>(seen.part[i]) != Part::test;
  return false;
}

void LiveModel::compare(Reconstruction& made, std::span<const float> camera_map_m) const {
  if (made.map_m.empty() || made.map_m.size() != camera_map_m.size()) return;
  const MapScores scores = score(made.map_m, camera_map_m, model_->scene);
  if (std::isfinite(scores[metric_iou])) made.iou = scores[metric_iou];
  if (std::isfinite(scores[metric_lateral_m])) made.lateral_error_m = scores[metric_lateral_m];
}

std::string LiveModel::doubt(const record::RunReader& run, std::int64_t first,
                             std::int64_t count) const {
  try {
    Dataset data =
        load_part(run, first, static_cast<std::size_t>(count), sensors_of(model_->features.inputs),
                  [](std::int64_t, const std::string&) {});
    if (data.size() == 0) return {};
    const Records records = prepare_records(model_, std::move(data));
    const DomainShift shift = domain_shift_of(model_, records.data);
    return shift.found() ? shift.text() : "";
  } catch (const Error&) {
    return {};  // each record reports the reason
  }
}

}  // namespace echofuse::view
