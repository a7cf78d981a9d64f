// SPDX-License-Identifier: MIT
#include "recon/models/factorised.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "drivers/util/exit_code.hpp"
#include "recon/method/alignment.hpp"
#include "recon/metrics/scene_model.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t records_per_batch = 4096;  // batch size in records; limits memory use
constexpr float nearest_m = 0.1f;                // minimum range of a body, m
// Minimum scale of an input, relative to the median of all scales.
constexpr double min_deviation = 0.05;
// Range and step of the mask threshold, in percent. The threshold with the best IoU on held-out
// records is used. If the position is uncertain, a threshold below 50 % is best, because a wider
// mask overlaps the body better.
constexpr int min_threshold = 25, max_threshold = 60, threshold_step = 5;
// Width of the two hidden layers of each network. If there are at least `many_records` records, the
// networks are wider, and are trained for fewer epochs with larger batches.
constexpr std::size_t many_records = 10'000, units = 48, units_of_many = 96;
// Number of networks that are averaged; their mean is more accurate than a single network.
constexpr std::size_t place_networks = 3;
constexpr std::size_t shape_networks = 2;  // number of shape networks; 1 if there are many records
// Weight of the depth error relative to the lateral error. The depth is almost equal to the range;
// with a larger weight, the network learns less about the lateral position.
constexpr float depth_weight = 0.1f;
// If there are at least this many bodies, only half of them are rotated, because rotation is an
// approximation.
constexpr std::size_t many_bodies = 40'000;
// Number of bodies used to compute the components; more would hardly change them.
constexpr std::size_t component_bodies = 3000;

float intersection_over_union(std::span<const float> map, std::span<const float> truth,
                              std::span<const float> background) {
  int both = 0, any = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    const bool a = map[p] != background[p], b = true_foreground(truth[p], background[p]);
    both += a && b, any += a || b;
  }
  return any > 0 ? static_cast<float>(both) / static_cast<float>(any) : 0;
}

// Returns the targets of the position networks, m: the lateral position at the range of the body,
// and its mean depth minus that range.
std::array<float, 2> position_target(const Place& place, float range_m) {
  return {place.tangent * range_m, place.depth_m - range_m};
}

// Adapts the training options to the number of records. With many records, fewer epochs, larger
// batches and less weight decay are sufficient.
void adapt_to(std::size_t records, Training& training) {
  const bool many = records >= many_records;
  training.hidden.assign(2, many ? units_of_many : units);
  if (!many) return;
  const double times = static_cast<double>(records) / static_cast<double>(many_records);
  const double epochs = static_cast<double>(training.epochs) / std::pow(times, 0.25);
  training.epochs = static_cast<std::size_t>(std::max(1L, std::lround(epochs)));
  training.batch *= 4;
  training.weight_decay /= times;
}

}  // namespace

Factorised::Bodies Factorised::bodies_in(const Samples& samples) const {
  Bodies out{recon::bodies_in(samples.inputs, samples.maps, samples.rows, model_.background,
                              samples.scene->grid),
             {}};
  out.views = take_rows(samples.inputs, out.rows);
  return out;
}

void Factorised::learn_scale(const Matrix& features) {
  const ColumnStatistics columns = column_statistics(features, all_rows(features.rows));
  model_.centre.assign(columns.mean.begin(), columns.mean.end());
  model_.deviation.resize(features.cols);
  for (std::size_t c = 0; c < features.cols; ++c)
    model_.deviation[c] = static_cast<float>(std::sqrt(columns.variance[c]));
  std::vector<float> sorted = model_.deviation;
  const float minimum = static_cast<float>(min_deviation) * quantile(sorted, 0.5);
  for (float& deviation : model_.deviation) {
    deviation = std::max(deviation, minimum);
    if (deviation == 0) deviation = 1;
  }
}

TrainingLog Factorised::fit(const Samples& train, const Samples& validation,
                            const FitOptions& options) {
  model_.background = train.scene->background;
  Bodies seen = bodies_in(train), assessed = bodies_in(validation);
  if (seen.rows.size() < 2)
    throw Error(ExitCode::failed,
                "fewer than two training records show a body in the depth map, the histogram and "
                "the range profile");
  model_.nearest_m = nearest_m;
  learn_scale(seen.views);
  for (Bodies* s : {&seen, &assessed})
    for (std::size_t i = 0; i < s->views.rows; ++i) standardise(s->views.row(i), model_);
  RotatedBodies rotated(*train.alignment, train.inputs, *train.radar, *train.array, seen.rows,
                        seen.places);
  if (seen.rows.size() >= many_bodies) rotated.rotate_share(0.5);
  TrainingLog log = fit_position(seen, rotated, assessed, options);
  fit_components(seen, train, options);
  if (model_.has_shapes)
    log.interrupted |= fit_shape(seen, train, rotated, assessed, validation, options);
  if (assessed.rows.empty())
    choose_threshold(seen, train);
  else
    choose_threshold(assessed, validation);
  return log;
}

// Returns a data augmentation that rotates every body of a batch. retarget(place, range_m, target)
// writes the training targets for the new position. Returns an empty function if bodies cannot be
// rotated. Validation uses the unmodified records.
Redraw Factorised::augment(const RotatedBodies& rotated, const Retarget& retarget) const {
  if (!rotated.changes()) return {};
  return [this, &rotated, retarget](std::span<const std::size_t> batch, Matrix& inputs,
                                    Matrix& targets, Rng& rng) {
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const Place place = rotated.rotate(batch[i], rng, inputs.row(i));
      retarget(place, inputs.row(i).back(), targets.row(i));
      standardise(inputs.row(i), model_);
    }
  };
}

Redraw Factorised::augment_positions(const RotatedBodies& rotated) const {
  return augment(rotated, [](const Place& place, float range_m, std::span<float> out) {
    const auto target = position_target(place, range_m);
    std::copy(target.begin(), target.end(), out.begin());
  });
}

// Keeps the target shapes. The depth camera is at the position of the SPD, so rotation about the
// SPD does not change the shape recorded by the camera.
Redraw Factorised::augment_shapes(const RotatedBodies& rotated) const {
  return augment(rotated, [](const Place&, float, std::span<float>) {});
}

Matrix Factorised::position_targets(const Bodies& seen) const {
  Matrix out(0, 2);
  for (std::size_t i = 0; i < seen.rows.size(); ++i)
    out.add_row(position_target(seen.places[i], range_of(seen.views.row(i), model_)));
  return out;
}

TrainingLog Factorised::fit_position(const Bodies& train, const RotatedBodies& rotated,
                                     const Bodies& validation, const FitOptions& options) {
  const Matrix expected = position_targets(train), assessed = position_targets(validation);
  const Rows rows = all_rows(train.rows.size()), assessed_rows = all_rows(validation.rows.size());
  Training training = training_of(options);
  adapt_to(rows.size(), training);
  training.weights = {1, depth_weight};
  training.redraw = augment_positions(rotated);
  return model_.place.fit({train.views, expected, rows},
                          {validation.views, assessed, assessed_rows}, Spread::each, training,
                          place_networks, "position");
}

void Factorised::fit_components(const Bodies& train, const Samples& samples,
                                const FitOptions& options) {
  model_.frame =
      BodyFrame(samples.maps, model_.background, train.rows, train.places, samples.scene->grid);
  const std::size_t basis = model_.has_shapes ? options.basis.value() : 0;
  const std::size_t count = std::min(train.rows.size(), component_bodies);
  Rows some;
  for (std::size_t i = 0; i < count; ++i) some.push_back(i * train.rows.size() / count);
  Shapes bodies = cut(train, samples, some);
  model_.masks = principal_components(std::move(bodies.masks), basis, options.seed);
  model_.depths = principal_components(std::move(bodies.depths), (basis + 1) / 2, options.seed + 1);
}

// Returns true if the training was interrupted.
bool Factorised::fit_shape(const Bodies& train, const Samples& train_samples,
                           const RotatedBodies& rotated, const Bodies& validation,
                           const Samples& validation_samples, const FitOptions& options) {
  const Matrix expected = amounts(train, train_samples);
  const Matrix assessed = amounts(validation, validation_samples);
  const Rows rows = all_rows(train.rows.size()), assessed_rows = all_rows(validation.rows.size());
  Training training = training_of(options);
  adapt_to(rows.size(), training);
  training.redraw = augment_shapes(rotated);
  return model_.shape
      .fit({train.views, expected, rows}, {validation.views, assessed, assessed_rows},
           Spread::common, training, rows.size() >= many_records ? 1 : shape_networks, "shape")
      .interrupted;
}

Shapes Factorised::cut(const Bodies& seen, const Samples& samples, const Rows& which) const {
  Shapes out{Matrix(which.size(), model_.frame.size()), Matrix(which.size(), model_.frame.size())};
  for (std::size_t i = 0; i < which.size(); ++i)
    model_.frame.cut(samples.maps.row(seen.rows[which[i]]), model_.background,
                     seen.places[which[i]], out.masks.row(i), out.depths.row(i));
  return out;
}

// Returns the principal-component coefficients of each body, first those of the mask, then those of
// the depths. Each of these two groups is divided by its largest standard deviation.
Matrix Factorised::amounts(const Bodies& seen, const Samples& samples) const {
  const std::size_t records = seen.rows.size(), masks = model_.masks.basis.rows;
  Matrix out(records, masks + model_.depths.basis.rows);
  const auto put = [&](const Matrix& bodies, const Components& components, std::size_t row,
                       std::size_t column) {
    const Matrix found = coordinates(components, bodies);
    const float unit = unit_of(components);
    for (std::size_t i = 0; i < found.rows; ++i)
      for (std::size_t k = 0; k < found.cols; ++k)
        out.row(row + i)[column + k] = found.row(i)[k] / unit;
  };
  for (std::size_t first = 0; first < records; first += records_per_batch) {
    Rows which = all_rows(std::min(records_per_batch, records - first));
    for (std::size_t& i : which) i += first;
    const Shapes bodies = cut(seen, samples, which);
    put(bodies.masks, model_.masks, first, 0);
    put(bodies.depths, model_.depths, first, masks);
  }
  return out;
}

void Factorised::choose_threshold(const Bodies& seen, const Samples& samples) {
  const std::vector<Place> places = place(seen.views, model_);
  const Shapes shapes = shape(seen.views, model_);
  std::vector<float> map(model_.background.size());
  double best = -1;
  for (int percent = min_threshold; percent <= max_threshold; percent += threshold_step) {
    double sum = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
      map = model_.background;
      model_.frame.draw(shapes.masks.row(i), shapes.depths.row(i), places[i],
                        static_cast<float>(percent) / 100, map);
      sum +=
          double{intersection_over_union(map, samples.maps.row(seen.rows[i]), model_.background)};
    }
    if (sum > best) best = sum, model_.threshold = static_cast<float>(percent) / 100;
  }
}

FitOptions Factorised::sizes() const {
  // The number of depth components is half the number of mask components.
  const std::size_t amounts = model_.masks.basis.rows + model_.depths.basis.rows;
  FitOptions out;
  if (amounts > 0) out.basis = 2 * amounts / 3;
  return out;
}

std::unique_ptr<Model> make_factorised() { return std::make_unique<Factorised>(true); }
std::unique_ptr<Model> make_mean_shape() { return std::make_unique<Factorised>(false); }

}  // namespace echofuse::recon
