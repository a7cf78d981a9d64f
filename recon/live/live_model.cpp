// SPDX-License-Identifier: MIT
#include "recon/live/live_model.hpp"

#include <cmath>
#include <filesystem>

#include "drivers/util/printable.hpp"
#include "recon/metrics/metrics.hpp"
#include "recon/predict/predict.hpp"

namespace echofuse::view {
namespace {

using namespace recon;

Reconstruction made(const TrainedModel& whole, const record::RunReader& run, std::int64_t index,
                    PredictionDetail detail) {
  Reconstruction out;
  out.grid = whole.first().scene.grid;
  MappedRecord mapped = map_record(whole, run, index, detail);
  const RecordStatus& status = mapped.status;
  out.fault = status.fault, out.note = status.note;
  if (!out.fault.empty()) return out;
  if (status.body) out.x_m = status.body->x_m, out.z_m = status.body->z_m;
  out.map_m = thresholded_map(mapped.map_m, whole.first().scene);
  if (!status.uncertainty) return out;
  const PredictionUncertainty& u = *status.uncertainty;
  out.deviation_m = std::move(mapped.deviation_m);
  if (std::isfinite(u.lateral_interval_90_m)) out.lateral_interval_90_m = u.lateral_interval_90_m;
  if (const std::string more = u.out_of_distribution.text(); !more.empty())
    out.note += (out.note.empty() ? "" : "; ") + more;
  return out;
}

}  // namespace

LiveModel::LiveModel(const std::string& path)
    : model_(load_model(path)),
      name_(printable(std::filesystem::path(path).filename().string()) + " (" +
            model_.first().name + ")") {}

Reconstruction LiveModel::reconstruct(const record::RunReader& run, std::int64_t index,
                                      bool with_deviation) const {
  try {
    return made(model_, run, index,
                with_deviation ? fullest_detail(model_) : PredictionDetail::uncertainty);
  } catch (const Error& e) {
    Reconstruction out;
    out.fault = e.what();
    return out;
  }
}

bool LiveModel::saw(const std::string& run_uuid, std::int64_t index) const {
  const TrainingRecords& training = model_.training;
  for (std::size_t i = 0; i < training.index.size(); ++i)
    if (training.index[i] == index && training.runs[training.run[i]] == run_uuid)
      return static_cast<Subset>(training.part[i]) != Subset::test;
  return false;
}

void LiveModel::compare(Reconstruction& made, std::span<const float> camera_map_m) const {
  if (made.map_m.empty() || made.map_m.size() != camera_map_m.size()) return;
  const MapScores scores = score(made.map_m, camera_map_m, model_.first().scene);
  if (std::isfinite(scores[metric_iou])) made.iou = scores[metric_iou];
  if (std::isfinite(scores[metric_lateral_m])) made.lateral_error_m = scores[metric_lateral_m];
}

GroupCheck LiveModel::check(const record::RunReader& run, std::int64_t first,
                            std::int64_t count) const {
  try {
    Dataset data = load_part(run, first, static_cast<std::size_t>(count),
                             sensors_of(model_.first().features.inputs),
                             [](std::int64_t, const std::string&) {});
    if (data.size() == 0) return {};
    const Records records = prepare_records(model_, std::move(data));
    const DomainShift shift = domain_shift_of(model_, records.data);
    return {shift.found() ? shift.text() : "", shift.interval_factor};
  } catch (const Error&) {
    return {};  // the message of each record reports the error
  }
}

}  // namespace echofuse::view
