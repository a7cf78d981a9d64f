// SPDX-License-Identifier: MIT
#include "echofuse/predict.hpp"

#include <algorithm>
#include <cmath>

#include "drivers/util/format.hpp"
#include "recon/api/internals.hpp"
#include "recon/predict/predict.hpp"

namespace echofuse {
namespace {

// Names are imported one by one, because recon::Model would clash with echofuse::Model.
using recon::Column, recon::ColumnAxis, recon::Dataset, recon::Features, recon::MappedRecord,
    recon::Matrix, recon::RecordStatus, recon::SceneModel, recon::TrainedModel;

DepthMap public_map(MappedRecord made, const SceneModel& scene) {
  RecordStatus& status = made.status;
  DepthMap out;
  out.fault = std::move(status.fault), out.note = std::move(status.note);
  out.doubt = std::move(status.doubt);
  if (!out.fault.empty()) return out;
  out.depth_m = thresholded_map(made.map_m, scene);
  if (status.uncertainty) out.deviation_m = std::move(made.deviation_m);
  if (status.body) out.body = Body{status.body->x_m, status.body->z_m, {}};
  if (!status.uncertainty) return out;
  const double interval_m = status.uncertainty->lateral_interval_90_m;
  if (out.body && std::isfinite(interval_m)) out.body->lateral_interval_90_m = interval_m;
  out.out_of_distribution = status.uncertainty->out_of_distribution.text();
  return out;
}

// Copies `values` to a column with one row on the axis of the model. The row contains zeros if
// `values` is empty. `limit`: lowest accepted value.
void put_row(Column& column, const ColumnAxis& axis, std::span<const float> values,
             const char* name, std::optional<float> limit = {}) {
  const std::size_t expected = axis.size();
  const auto refuse = [&](const std::string& fault) {
    throw Error(ExitCode::usage, std::string(name) + ": " + fault + "; the model expects " +
                                     std::to_string(expected) + " finite values" +
                                     (limit ? format(" of at least %g", double{*limit}) : ""));
  };
  if (!values.empty() && values.size() != expected)
    refuse(std::to_string(values.size()) + " values");
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!is_power(values[i]) || (limit && values[i] < *limit))
      refuse("value " + std::to_string(i) + " is " + format("%g", double{values[i]}));
  column = Matrix(1, expected), column.axis = axis;
  std::ranges::copy(values, column.row(0).begin());
}

// Makes a one-record data set on the model's axes. The ranges of `spd` and `radar` must be free of
// bias.
Dataset dataset_of(const TrainedModel& model, std::span<const float> spd,
                   std::span<const float> radar) {
  const Features& takes = model.first().features;
  Dataset data;
  data.map = model.first().scene.grid;
  data.depth() = Matrix(1, 0);
  SensorSet valid;
  if (takes.spd_count() > 0) {
    // Arrays state no directions of the zones, so those of the model are assumed.
    put_row(data.spd(), takes.axes.spd, spd, "spd", 0.0F);
    if (!spd.empty()) valid.insert(Sensor::spd);
  }
  if (takes.radar_count() > 0) {
    put_row(data.radar(), takes.axes.radar, radar, "radar");
    if (!radar.empty()) valid.insert(Sensor::radar);
  }
  data.records.resize(1);
  data.records[0].valid = valid;
  data.sources.resize(1);
  data.sources[0].count = 1;
  return data;
}

DepthMap map_of(const TrainedModel& model, Dataset data) {
  const bool complete = has_inputs(data, 0, model.for_run(data).features.inputs);
  DepthMap out =
      public_map(map_record(model, std::move(data), fullest_detail(model)), model.first().scene);
  if (!out.fault.empty())
    out.fault_code = complete ? FaultCode::constant_values : FaultCode::sensor_missing;
  return out;
}

}  // namespace

Exception::Exception(ErrorCode code, const std::string& text)
    : std::runtime_error(text), code_(code) {}

Model::Model(const std::string& path)
    : file_(guarded(ErrorCode::damaged, [&] {
        TrainedModel model = recon::load_model(path);
        std::string inputs = name_of(model.first().features.inputs);
        return std::make_shared<File>(std::move(model), std::move(inputs));
      })) {}

const std::string& Model::name() const { return file_->model.first().name; }
const std::string& Model::inputs() const { return file_->inputs; }
bool Model::calibrated() const { return file_->model.first().uncertainty.has_value(); }
RunAxis Model::spd_axis() const {
  const Features& takes = file_->model.first().features;
  return takes.spd_count() > 0 ? public_axis(takes.axes.spd) : RunAxis{};
}
RunAxis Model::radar_axis() const {
  const Features& takes = file_->model.first().features;
  return takes.radar_count() > 0 ? public_axis(takes.axes.radar) : RunAxis{};
}
std::size_t Model::zones() const { return file_->model.first().features.axes.spd.zones.size(); }
MapGrid Model::grid() const { return public_grid(file_->model.first().scene.grid); }

DepthMap predict(const Model& model, const Record& record) {
  const TrainedModel& trained = Internals::model(model);
  const Internals::RecordContents& contents = Internals::contents(record);
  return guarded(ErrorCode::usage, [&] {
    DepthMap out;
    Dataset data = recon::load_record(*contents.run, contents.record,
                                      sensors_of(trained.first().features.inputs), out.fault);
    if (!out.fault.empty()) return out.fault_code = FaultCode::damaged, out;
    return map_of(trained, std::move(data));
  });
}

DepthMap predict(const Model& model, std::span<const float> spd, std::span<const float> radar) {
  const TrainedModel& trained = Internals::model(model);
  return guarded(ErrorCode::usage,
                 [&] { return map_of(trained, dataset_of(trained, spd, radar)); });
}

}  // namespace echofuse
