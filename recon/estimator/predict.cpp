// SPDX-License-Identifier: MIT
#include "recon/estimator/predict.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "drivers/core/clones.hpp"
#include "recon/estimator/empty_room.hpp"
#include "recon/estimator/separate.hpp"
#include "recon/uncertainty/predictors.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t at_once = 512;  // bounds the memory that a prediction needs

// Without an end before the last value: the compiler makes vectors of that.
ECHOFUSE_CLONES bool all_finite(const float* values, std::size_t count) {
  constexpr std::uint32_t exponent = 0x7f800000;
  std::uint32_t beyond = 0;
  for (std::size_t i = 0; i < count; ++i)
    beyond |= std::uint32_t{(std::bit_cast<std::uint32_t>(values[i]) & exponent) == exponent};
  return beyond == 0;
}

// Of one model without its fallbacks; row i of `aligned` belongs to rows[i].
Prediction predict_aligned(const TrainedModel& model, const Dataset& data, const Rows& rows,
                           const Matrix& aligned, PredictionDetail detail) {
  Prediction out;
  SoftMaps soft;
  out.maps = model.model->predict(model.inputs(data, rows, aligned),
                                  detail == PredictionDetail::pixels ? &soft : nullptr);
  require_finite(out.maps);
  if (detail == PredictionDetail::maps || !model.uncertainty) return out;
  const UncertaintyModel& uncertainty = *model.uncertainty;
  const Matrix predictors = predictors_of(out.maps, model.scene, data, rows, model.features.inputs);
  std::vector<double> lateral_interval_90_m;
  for (std::size_t i = 0; i < rows.size(); ++i)
    lateral_interval_90_m.push_back(uncertainty.lateral(predictors.row(i)));
  auto out_of_distribution = uncertainty.detector.judge(aligned, data, rows);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    out.uncertainties.push_back({lateral_interval_90_m[i], std::move(out_of_distribution[i])});
    uncertainty.judge_speckle(aligned.row(i), data.speckle[rows[i]], out.uncertainties.back());
  }
  separate_bodies(model, data, rows, out, detail == PredictionDetail::pixels ? &soft : nullptr);
  if (detail == PredictionDetail::uncertainty) return out;
  // The blur of a record taken apart goes with what is stated of its less certain body.
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (const auto& two = out.uncertainties[i].bodies; !two.empty())
      if (const double widest_m =
              std::fmax(two[0].lateral_interval_90_m, two[1].lateral_interval_90_m);
          !std::isnan(widest_m))
        lateral_interval_90_m[i] = widest_m;
  soft = soft_of(std::move(soft), out.maps, model.scene, lateral_interval_90_m);
  PixelMaps pixels = uncertainty.pixels(soft, model.scene);
  require_finite(pixels.mean), require_finite(pixels.deviation);
  out.mean = std::move(pixels.mean), out.deviation = std::move(pixels.deviation);
  return out;
}

// Moves row i of a part to row places[i] of the whole.
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

// `aligned`: of every record of the data, or none.
Prediction predict(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   const Matrix* aligned, PredictionDetail detail) {
  if (detail == PredictionDetail::pixels) require_uncertainty(model);
  Prediction out;
  out.maps.cols = model.scene.background.size();
  for (const auto& [by, places, own_rows] : model.assign_rows(data, rows))
    for (std::size_t first = 0; first < places.size(); first += at_once) {
      const std::size_t count = std::min(at_once, places.size() - first);
      const auto begin = own_rows.begin() + static_cast<std::ptrdiff_t>(first);
      const Rows some(begin, begin + static_cast<std::ptrdiff_t>(count));
      const bool shared = aligned && &by == &model.for_run(data);
      put(out,
          predict_aligned(by, data, some,
                          shared ? take_rows(*aligned, some)
                                 : by.align(data, some, detail != PredictionDetail::maps),
                          detail),
          std::span(places).subspan(first, count), rows.size());
    }
  return out;
}

}  // namespace

void require_finite(const Matrix& maps) {
  if (all_finite(maps.values.data(), maps.values.size())) return;
  throw Error(
      ExitCode::failed,
      "the model's maps are not finite numbers: its weights are none that a training makes; "
      "train it again");
}

void forget_brightness(const Alignment& alignment, Matrix& aligned) {
  if (alignment.gains() == Gains::unknown) return;
  for (std::size_t i = 0; i < aligned.rows; ++i)
    Brightness::forget(alignment.brightness_of(aligned.row(i)));
}

Records prepare_records(const TrainedModel& whole, Dataset recorded, RangeBiasAction action) {
  const TrainedModel& model = whole.for_run(recorded);
  const bool asked = action != RangeBiasAction::ignore && model.range_bias.known();
  const bool correct = action == RangeBiasAction::correct;
  Records out{std::move(recorded), {}, {}, 0, {}, {}, {}};
  Dataset& data = out.data;
  if (&model != &whole)
    out.antennas = std::string(data.array_axis.count == 0 ? "no samples of the radar's antennas"
                                                          : "other antennas than in training") +
                   ": of the radar, the range profile alone";
  const Matrix profiles = asked && correct ? data.radar : Matrix{};
  const Axis axis = data.radar_axis;
  const std::vector<Source> sources = data.sources;
  const auto align = [&](double range_bias_m) {
    subtract_range_offset(data, range_bias_m);
    model.match(data);
    if (model.room_change) exchange_room(*model.room_change, data, range_bias_m == 0);
    out.aligned = model.align(data, all_rows(data.size()), true);
    if (model.alignment.gains() == Gains::unknown) return;
    out.gains = check_gains(model.alignment, out.aligned);
    if (!out.gains.stable) forget_brightness(model.alignment, out.aligned);
  };
  align(0);
  if (model.uncertainty) out.speckle = model.uncertainty->speckle.of_run(data, out.aligned);
  if (!asked) return out;
  out.range_bias = model.range_bias.judge(model.alignment, data, out.aligned, out.gains);
  using Says = RangeBiasEvidence::Says;
  const bool detected = out.range_bias.status == RangeBias::Status::detected;
  const Says says = out.range_bias.evidence.says;
  const bool others = detected && says != Says::range_bias && !out.range_bias.by_echoes &&
                      model.domain.judge(model.alignment, data, out.aligned, {}).changes_shapes();
  const bool corrected = detected && correct && !others && says != Says::no_range_bias;
  out.text = out.range_bias.text(corrected, others);
  if (!corrected) return out;
  data.radar = profiles, data.radar_axis = axis, data.sources = sources;
  align(out.range_bias_m = out.range_bias.bias_m);
  return out;
}

DomainShift domain_shift_of(const TrainedModel& whole, const Records& records) {
  const TrainedModel& model = whole.for_run(records.data);
  RangeBias moved = records.range_bias;
  if (moved.records == 0 || records.range_bias_m != 0)  // nobody looked, or it was taken off
    moved = model.range_bias.judge(
        model.range_bias.measure(model.alignment, records.data, records.aligned));
  return model.domain.judge(model.alignment, records.data, records.aligned, moved);
}

Prediction predict(const TrainedModel& model, const Records& records, const Rows& rows,
                   PredictionDetail detail) {
  return predict(model, records.data, rows, &records.aligned, detail);
}

Prediction predict(const TrainedModel& model, const Dataset& data, const Rows& rows,
                   PredictionDetail detail) {
  return predict(model, data, rows, nullptr, detail);
}

Matrix TrainedModel::predict(const Dataset& data, const Rows& rows) const {
  return recon::predict(*this, data, rows, PredictionDetail::maps).maps;
}

void require_uncertainty(const TrainedModel& model) {
  if (!model.uncertainty)
    throw Error(
        ExitCode::usage,
        "the model does not know how sure it is: it was trained on too few records (less than "
        "50), its training was interrupted, or an older version trained it; train it "
        "anew");
}

}  // namespace echofuse::recon
