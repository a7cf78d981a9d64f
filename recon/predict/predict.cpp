// SPDX-License-Identifier: MIT
#include "recon/predict/predict.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <tuple>

#include "drivers/core/clones.hpp"
#include "recon/predict/empty_room.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t batch_records = 512;  // batch size in records; limits memory use

// Has no early exit, so that the compiler can vectorise the loop.
ECHOFUSE_CLONES bool all_finite(const float* values, std::size_t count) {
  constexpr std::uint32_t exponent = 0x7f800000;
  std::uint32_t beyond = 0;
  for (std::size_t i = 0; i < count; ++i)
    beyond |= std::uint32_t{(std::bit_cast<std::uint32_t>(values[i]) & exponent) == exponent};
  return beyond == 0;
}

Prediction predict_by(const Estimator& by, const Dataset& data, const Rows& rows,
                      PredictionDetail detail) {
  Prediction out;
  SoftMaps soft;
  const Matrix views = by.views(data, rows, detail != PredictionDetail::maps);
  out.maps = by.maps(data, rows, views, detail == PredictionDetail::pixels ? &soft : nullptr);
  require_finite(out.maps);
  if (detail == PredictionDetail::pixels && !by.uncertainty) {
    out.mean = out.deviation = out.maps;
    std::ranges::fill(out.deviation.values, std::numeric_limits<float>::quiet_NaN());
  }
  if (detail == PredictionDetail::maps || !by.uncertainty) return out;
  const UncertaintyModel& uncertainty = *by.uncertainty;
  out.uncertainties = uncertainty.trust(views, out.maps, by.scene, data, rows, by.features.inputs);
  if (detail == PredictionDetail::uncertainty) return out;
  std::vector<double> lateral_interval_90_m;
  for (const PredictionUncertainty& u : out.uncertainties)
    lateral_interval_90_m.push_back(u.lateral_interval_90_m);
  soft = soft_of(std::move(soft), out.maps, by.scene, lateral_interval_90_m);
  std::tie(out.mean, out.deviation) = uncertainty.pixels(soft, by.scene);
  require_finite(out.mean), require_finite(out.deviation);
  return out;
}

// Copies row i of `part` to row places[i] of `whole`, which has `records` rows.
void put(Prediction& whole, Prediction part, std::span<const std::size_t> places,
         std::size_t records) {
  if (places.size() == records) return void(whole = std::move(part));
  const auto put_rows = [&](Matrix& to, const Matrix& from) {
    if (to.rows == 0) to = Matrix(from.rows > 0 ? records : 0, from.cols);
    for (std::size_t i = 0; i < from.rows; ++i)
      std::copy(from.row(i).begin(), from.row(i).end(), to.row(places[i]).begin());
  };
  put_rows(whole.maps, part.maps);
  put_rows(whole.mean, part.mean), put_rows(whole.deviation, part.deviation);
  if (!part.uncertainties.empty()) whole.uncertainties.resize(records);
  for (std::size_t i = 0; i < part.uncertainties.size(); ++i)
    whole.uncertainties[places[i]] = std::move(part.uncertainties[i]);
}

// Returns a note about errors that the 90 % intervals do not include. Returns an empty string if
// the run contains a calibration and the sensor baseline.
std::string assumption_of(const Estimator& by, const Dataset& data) {
  if (!by.uncertainty || data.radar().axis.count == 0 || !side_by_ranges(data, by.features.inputs))
    return {};
  const auto all = [&](auto stated) { return std::ranges::all_of(data.sources, stated); };
  if (!all([](const Source& run) { return run.calibration_error_m.has_value(); }))
    return "90 % intervals assume calibrated ranges, but the run does not contain a calibration of "
           "both sensors; a range bias of 2 cm moves a body sideways by 2 cm x range / baseline";
  if (!all([](const Source& run) { return run.mounting.baseline_m > 0; }))
    return "90 % intervals do not include the range error, because the run does not contain "
           "radar_baseline_m";
  return {};
}

}  // namespace

void require_finite(const Matrix& maps) {
  if (all_finite(maps.values.data(), maps.values.size())) return;
  throw Error(
      ExitCode::failed,
      "predicted maps contain values that are not finite, because the weights of the model are "
      "invalid; train the model again");
}

Records prepare_records(const TrainedModel& model, Dataset recorded, double range_offset_m) {
  const Estimator& by = model.for_run(recorded);
  Records out{std::move(recorded), {}, {}, {}};
  Dataset& data = out.data;
  if (&by != &model.first())
    out.antennas =
        std::string(data.array().axis.count == 0 ? "contains no radar antenna samples"
                                                 : "radar antennas differ from those in training") +
        ": only the radar's range profile is used";
  out.response = model.response.note(data);
  subtract_range_offset(data, range_offset_m);
  model.match(data);
  out.ranges = assumption_of(by, data);
  exchange_room(model.room_change, data);
  return out;
}

namespace {

Rows unseen_rows(const TrainedModel& model, const Dataset& data) {
  if (model.was_trained_on(data)) return model.rows_of(data, Subset::test);
  Rows out;
  std::ranges::set_difference(all_rows(data.size()), model.rows_trained_on(data),
                              std::back_inserter(out));
  return out;
}

}  // namespace

DomainShift domain_shift_of(const TrainedModel& model, const Dataset& run) {
  constexpr std::size_t max_assessed = 200;
  const Rows rows = unseen_rows(model, run);
  Dataset part;
  if (rows.size() < run.size()) {
    part = part_of(run, rows);
    if (run.sources.size() == 1) part.sources = run.sources, part.sources[0].count = rows.size();
  }
  const Dataset& data = rows.size() < run.size() ? part : run;
  const Estimator& by = model.for_run(data);
  const Rows all = all_rows(data.size());
  DomainShift out = by.domain.test(by.alignment, data, by.views(data, all, true));
  Rows live, some;
  for (const std::size_t row : all)
    if (model.fault_of(data, row).empty()) live.push_back(row);
  for (std::size_t i = 0; i < std::min(live.size(), max_assessed); ++i)
    some.push_back(live[i * live.size() / std::min(live.size(), max_assessed)]);
  std::map<std::string, std::size_t> reasons;
  for (const auto& u : predict(model, data, some).uncertainties) {
    out.assessed += u.stated;
    const std::string& reason = u.out_of_distribution.reason;
    if (!reason.empty() && (++out.flagged, ++reasons[reason] > reasons[out.reason]))
      out.reason = reason;
  }
  return out;
}

Prediction predict(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   PredictionDetail detail) {
  if (detail == PredictionDetail::pixels) require_uncertainty(model);
  const Estimator& usual = model.for_run(data);
  std::vector<const Estimator*> estimator_for;
  for (const std::size_t row : rows) estimator_for.push_back(model.estimator_for(data, row));
  Prediction out;
  out.maps.cols = model.first().scene.background.size();
  for (const Estimator& by : model.estimators) {
    Rows places;  // indices into `rows`
    for (std::size_t i = 0; i < rows.size(); ++i)
      if ((estimator_for[i] ? estimator_for[i] : &usual) == &by) places.push_back(i);
    for (std::size_t first = 0; first < places.size(); first += batch_records) {
      const auto some =
          std::span(places).subspan(first, std::min(batch_records, places.size() - first));
      Rows own;
      for (const std::size_t place : some) own.push_back(rows[place]);
      put(out, predict_by(by, data, own, detail), some, rows.size());
    }
  }
  return out;
}

PredictionDetail fullest_detail(const TrainedModel& model) {
  return model.first().uncertainty ? PredictionDetail::pixels : PredictionDetail::maps;
}

std::vector<MappedRecord> map_records(const TrainedModel& model, const Records& records,
                                      std::span<const std::size_t> rows, PredictionDetail detail) {
  const Dataset& data = records.data;
  std::vector<MappedRecord> out;
  Rows usable, places;
  for (const std::size_t row : rows) {
    RecordStatus& status = out.emplace_back().status;
    status = {data.records[row].index, model.fault_of(data, row), model.note_of(data, row), {}};
    if (!status.fault.empty()) continue;
    const Estimator* by = model.estimator_for(data, row);
    status.doubt = doubt_of(data, row, (by ? *by : model.for_run(data)).features.inputs, false);
    usable.push_back(row), places.push_back(out.size() - 1);
  }
  const Prediction all = predict(model, data, usable, detail);
  for (std::size_t i = 0; i < usable.size(); ++i) {
    MappedRecord& made = out[places[i]];
    const auto map = all.maps.row(i);
    made.map_m.assign(map.begin(), map.end());
    if (const BodyPlace at = body_place(map, model.first().scene); !std::isnan(at.x_m))
      made.status.body = at;
    if (!all.uncertainties.empty() && all.uncertainties[i].stated)
      made.status.uncertainty = all.uncertainties[i];
    if (all.deviation.rows == 0) continue;
    const auto deviation = all.deviation.row(i);
    made.deviation_m.assign(deviation.begin(), deviation.end());
  }
  return out;
}

MappedRecord map_record(const TrainedModel& model, Dataset recorded, PredictionDetail detail) {
  // Checks for missing sensors first, because a run in progress may not yet have an axis for such a
  // sensor.
  if (std::string fault = model.fault_of(recorded, 0); !fault.empty())
    return {{recorded.records[0].index, std::move(fault), {}, {}}, {}, {}};
  const Records records = prepare_records(model, std::move(recorded));
  return std::move(map_records(model, records, std::vector<std::size_t>{0}, detail).front());
}

MappedRecord map_record(const TrainedModel& model, const record::RunReader& run, std::int64_t index,
                        PredictionDetail detail) {
  std::string fault = "cannot read the record";
  Dataset data = load_part(run, index, 1, sensors_of(model.first().features.inputs),
                           [&](std::int64_t at, const std::string& why) {
                             if (at == index) fault = why;
                           });
  if (data.size() == 0 || data.records[0].index != index) return {{index, fault, {}, {}}, {}, {}};
  return map_record(model, std::move(data), detail);
}

Matrix TrainedModel::predict(const Dataset& data, const Rows& rows) const {
  return recon::predict(*this, data, rows, PredictionDetail::maps).maps;
}

void require_uncertainty(const TrainedModel& model) {
  if (!model.first().uncertainty)
    throw Error(ExitCode::usage, std::string("the model is not calibrated: ") +
                                     reason_not_calibrated + "; train the model again");
}

}  // namespace echofuse::recon
