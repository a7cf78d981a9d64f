// SPDX-License-Identifier: MIT
#include "recon/models/factorised.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "drivers/core/exit_code.hpp"
#include "recon/maps/scene.hpp"
#include "recon/models/body/alignment.hpp"
#include "recon/numbers/parallel.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

// Hidden units that do best with few training records, and with many.
constexpr std::size_t many_records = 10'000, few_units = 48, many_units = 96;
// From so many on it shows that turning a body is an approximation.
constexpr std::size_t more_than_turned = 40'000;
// The depth is nearly known from the range: a network that cares for both learns less of the side.
const std::vector<float> position_weights = {1, 0.1f};
constexpr float nearest_m = 0.1f;  // that a body is taken to be
constexpr std::size_t position_networks = 3;
// From many records one network learns the shapes as well as two.
constexpr std::size_t shape_networks(std::size_t records) { return records < many_records ? 2 : 1; }
// For the components of the bodies; more records hardly turn them.
constexpr std::size_t most_bodies = 3000;
constexpr std::size_t cut_at_once = 4096;  // records, which bounds the memory
// Of the median one: where training records hardly ever have anything, one click more is no reason
// to go anywhere.
constexpr float least_deviation = 0.05f;

float intersection_over_union(std::span<const float> map, std::span<const float> truth,
                              std::span<const float> background) {
  int both = 0, any = 0;
  for (std::size_t p = 0; p < map.size(); ++p) {
    const bool a = map[p] != background[p], b = true_foreground(truth[p], background[p]);
    both += a && b, any += a || b;
  }
  return any > 0 ? static_cast<float>(both) / static_cast<float>(any) : 0;
}

// Metres to the right of the axis at the body's range, and how far its mean depth lies behind it.
std::array<float, 2> position_target(const Place& place, float range_m) {
  return {place.tangent * range_m, place.depth_m - range_m};
}

// Many records need fewer passes over them, in larger steps, and hold the weights back themselves.
void adapt_to(std::size_t records, Training& training) {
  const bool many = records >= many_records;
  training.hidden.assign(2, many ? many_units : few_units);
  if (!many) return;
  const double times = static_cast<double>(records) / static_cast<double>(many_records);
  const double epochs = static_cast<double>(training.epochs) / std::pow(times, 0.25);
  training.epochs = static_cast<std::size_t>(std::max(1L, std::lround(epochs)));
  training.batch *= 4;
  training.weight_decay /= times;
}

// Of the amounts of each kind, so that neither drowns the other.
float unit_of(const Components& components) {
  return std::max(components.deviation.front(), 1e-6f);
}

}  // namespace

Factorised::Seen Factorised::see(const Samples& samples) const {
  Seen out;
  out.features.cols = samples.inputs.cols;
  for (const std::size_t row : samples.rows) {
    const auto place = place_of(samples.maps.row(row), background_, samples.scene->grid);
    if (!place || !shows_body(samples.inputs.row(row))) continue;
    out.features.add_row(samples.inputs.row(row));
    out.rows.push_back(row);
    out.places.push_back(*place);
  }
  return out;
}

void Factorised::learn_scale(const Matrix& features) {
  const ColumnStatistics columns = column_statistics(features, all_rows(features.rows));
  centre_.assign(columns.mean.begin(), columns.mean.end());
  deviation_.resize(features.cols);
  for (std::size_t c = 0; c < features.cols; ++c)
    deviation_[c] = static_cast<float>(std::sqrt(columns.variance[c]));
  std::vector<float> sorted = deviation_;
  const float least = least_deviation * quantile(sorted, 0.5);
  for (float& deviation : deviation_) {
    deviation = std::max(deviation, least);
    if (deviation == 0) deviation = 1;
  }
}

float Factorised::range_of(std::span<const float> standardised) const {
  return standardised.back() * deviation_.back() + centre_.back();
}

void Factorised::standardise(std::span<float> features) const {
  for (std::size_t c = 0; c < features.size(); ++c)
    features[c] = (features[c] - centre_[c]) / deviation_[c];
}

TrainingLog Factorised::fit(const Samples& train, const Samples& validation,
                            const FitOptions& options) {
  background_ = train.scene->background;
  Seen seen = see(train), judged = see(validation);
  if (seen.rows.size() < 2)
    throw Error(ExitCode::failed,
                "fewer than two training records show a body in depth map, histogram and profile");
  learn_scale(seen.features);
  for (Seen* s : {&seen, &judged})
    for (std::size_t i = 0; i < s->features.rows; ++i) standardise(s->features.row(i));
  TurnedBodies turned(*train.alignment, train.inputs, *train.radar, *train.array, seen.rows,
                      seen.places);
  if (seen.rows.size() >= more_than_turned) turned.turn_share(0.5);
  TrainingLog log = fit_position(seen, turned, judged, options);
  fit_bodies(seen, train, options);
  if (shapes_) log.interrupted |= fit_shape(seen, train, turned, judged, validation, options);
  if (judged.rows.empty())
    choose_threshold(seen, train);
  else
    choose_threshold(judged, validation);
  return log;
}

// Turns every body of a batch; retarget(place, range_m, target) puts in what is wanted of it there.
// None if nobody is to be turned. Judged are records as they are.
Redraw Factorised::turning(const TurnedBodies& turned, const Retarget& retarget) const {
  if (!turned.changes()) return {};
  return [this, &turned, retarget](std::span<const std::size_t> batch, Matrix& inputs,
                                   Matrix& targets, Rng& rng) {
    for (std::size_t i = 0; i < batch.size(); ++i) {
      const Place place = turned.turn(batch[i], rng, inputs.row(i));
      retarget(place, inputs.row(i).back(), targets.row(i));
      standardise(inputs.row(i));
    }
  };
}

Redraw Factorised::turning_places(const TurnedBodies& turned) const {
  return turning(turned, [](const Place& place, float range_m, std::span<float> out) {
    const auto target = position_target(place, range_m);
    std::copy(target.begin(), target.end(), out.begin());
  });
}

// A body that is turned about the camera, which stands at the SPD, looks as before.
Redraw Factorised::turning_shapes(const TurnedBodies& turned) const {
  return turning(turned, [](const Place&, float, std::span<float>) {});
}

Matrix Factorised::position_targets(const Seen& seen) const {
  Matrix out(0, 2);
  for (std::size_t i = 0; i < seen.rows.size(); ++i)
    out.add_row(position_target(seen.places[i], range_of(seen.features.row(i))));
  return out;
}

TrainingLog Factorised::fit_position(const Seen& train, const TurnedBodies& turned,
                                     const Seen& validation, const FitOptions& options) {
  const Matrix wanted = position_targets(train), judged = position_targets(validation);
  const Rows rows = all_rows(train.rows.size()), judged_rows = all_rows(validation.rows.size());
  Training training = training_of(options);
  adapt_to(rows.size(), training);
  training.weights = position_weights;
  training.redraw = turning_places(turned);
  return positions_.fit({train.features, wanted, rows}, {validation.features, judged, judged_rows},
                        Spread::each, training, position_networks, "position");
}

void Factorised::fit_bodies(const Seen& train, const Samples& samples, const FitOptions& options) {
  frame_ = BodyFrame(samples.maps, background_, train.rows, train.places, samples.scene->grid);
  const std::size_t basis = shapes_ ? options.basis.value() : 0;
  const std::size_t count = std::min(train.rows.size(), most_bodies);
  Rows some;
  for (std::size_t i = 0; i < count; ++i) some.push_back(i * train.rows.size() / count);
  Shapes bodies = cut(train, samples, some);
  masks_ = principal_components(std::move(bodies.masks), basis, options.seed);
  reliefs_ = principal_components(std::move(bodies.reliefs), (basis + 1) / 2, options.seed + 1);
}

// True if it was interrupted.
bool Factorised::fit_shape(const Seen& train, const Samples& train_samples,
                           const TurnedBodies& turned, const Seen& validation,
                           const Samples& validation_samples, const FitOptions& options) {
  const Matrix wanted = amounts(train, train_samples);
  const Matrix judged = amounts(validation, validation_samples);
  const Rows rows = all_rows(train.rows.size()), judged_rows = all_rows(validation.rows.size());
  Training training = training_of(options);
  adapt_to(rows.size(), training);
  training.redraw = turning_shapes(turned);
  return shape_networks_
      .fit({train.features, wanted, rows}, {validation.features, judged, judged_rows},
           Spread::common, training, shape_networks(rows.size()), "shape")
      .interrupted;
}

Factorised::Shapes Factorised::cut(const Seen& seen, const Samples& samples,
                                   const Rows& which) const {
  Shapes out{Matrix(which.size(), frame_.size()), Matrix(which.size(), frame_.size())};
  for (std::size_t i = 0; i < which.size(); ++i)
    frame_.cut(samples.maps.row(seen.rows[which[i]]), background_, seen.places[which[i]],
               out.masks.row(i), out.reliefs.row(i));
  return out;
}

// How much of each component a body has, masks first; both kinds in units of their strongest one.
Matrix Factorised::amounts(const Seen& seen, const Samples& samples) const {
  const std::size_t records = seen.rows.size(), masks = masks_.basis.rows;
  Matrix out(records, masks + reliefs_.basis.rows);
  const auto put = [&](const Matrix& bodies, const Components& components, std::size_t row,
                       std::size_t column) {
    const Matrix found = coordinates(components, bodies);
    const float unit = unit_of(components);
    for (std::size_t i = 0; i < found.rows; ++i)
      for (std::size_t k = 0; k < found.cols; ++k)
        out.row(row + i)[column + k] = found.row(i)[k] / unit;
  };
  for (std::size_t first = 0; first < records; first += cut_at_once) {
    Rows which = all_rows(std::min(cut_at_once, records - first));
    for (std::size_t& i : which) i += first;
    const Shapes bodies = cut(seen, samples, which);
    put(bodies.masks, masks_, first, 0);
    put(bodies.reliefs, reliefs_, first, masks);
  }
  return out;
}

std::vector<Place> Factorised::find_places(const Matrix& features) const {
  const Matrix found = positions_.predict(features);
  std::vector<Place> out;
  for (std::size_t i = 0; i < found.rows; ++i) {
    const float range_m = range_of(features.row(i));
    out.push_back({found.row(i)[0] / std::max(range_m, nearest_m),
                   std::max(range_m + found.row(i)[1], nearest_m)});
  }
  return out;
}

Factorised::Shapes Factorised::find_shapes(const Matrix& features) const {
  const Matrix found = shapes_ ? shape_networks_.predict(features) : Matrix(features.rows, 0);
  const auto put_together = [&](const Components& components, std::size_t first) {
    Matrix amounts(features.rows, components.basis.rows);
    for (std::size_t i = 0; i < amounts.rows; ++i)
      for (std::size_t k = 0; k < amounts.cols; ++k)
        amounts.row(i)[k] = found.row(i)[first + k] * unit_of(components);
    return from_coordinates(components, amounts);
  };
  return {put_together(masks_, 0), put_together(reliefs_, masks_.basis.rows)};
}

// With an uncertain place the mask that overlaps best is wider than the one at a share of 1/2.
void Factorised::choose_threshold(const Seen& seen, const Samples& samples) {
  const std::vector<Place> places = find_places(seen.features);
  const Shapes shapes = find_shapes(seen.features);
  std::vector<float> map(background_.size());
  double best = -1;
  for (int percent = 25; percent <= 60; percent += 5) {
    double sum = 0;
    for (std::size_t i = 0; i < places.size(); ++i) {
      map = background_;
      frame_.draw(shapes.masks.row(i), shapes.reliefs.row(i), places[i],
                  static_cast<float>(percent) / 100, map);
      sum += double{intersection_over_union(map, samples.maps.row(seen.rows[i]), background_)};
    }
    if (sum > best) best = sum, threshold_ = static_cast<float>(percent) / 100;
  }
}

// Standardised features of the records that show a body, whose rows go to `with_body`.
Matrix Factorised::look(const Matrix& aligned, Rows& with_body) const {
  for (std::size_t i = 0; i < aligned.rows; ++i)
    if (shows_body(aligned.row(i))) with_body.push_back(i);
  Matrix features = take_rows(aligned, with_body);
  for (std::size_t i = 0; i < features.rows; ++i) standardise(features.row(i));
  return features;
}

// Place, shape, then the map, and if wanted its foreground probability and depth.
Matrix Factorised::predict(const Matrix& aligned, SoftMaps* soft) const {
  Matrix out = repeated_row(background_, aligned.rows);
  if (soft) *soft = {Matrix(out.rows, out.cols), out};
  Rows with_body;
  const Matrix features = look(aligned, with_body);
  if (with_body.empty()) return out;
  const std::vector<Place> places = find_places(features);
  const Shapes shapes = find_shapes(features);
  for_each_part(with_body.size(), [&](std::size_t i) {
    const auto mask = shapes.masks.row(i), relief = shapes.reliefs.row(i);
    const std::size_t row = with_body[i];
    frame_.draw(mask, relief, places[i], threshold_, out.row(row));
    if (soft)
      frame_.draw_soft(mask, relief, places[i], soft->foreground_probability.row(row),
                       soft->depth.row(row));
  });
  return out;
}

Cost Factorised::cost() const {
  const std::size_t basis = masks_.basis.values.size() + reliefs_.basis.values.size();
  Cost out{basis + frame_.draw_cost(), basis + masks_.mean.size() + reliefs_.mean.size() +
                                           2 * centre_.size() + background_.size()};
  out += positions_.cost();
  out += shape_networks_.cost();
  return out;
}

// From the amounts, of which those of this kind begin with `first`.
AffineLayer Factorised::cells_of(const Components& components, std::size_t first) const {
  AffineLayer out{Matrix(masks_.basis.rows + reliefs_.basis.rows, components.mean.size()),
                  components.mean};
  for (std::size_t k = 0; k < components.basis.rows; ++k)
    for (std::size_t c = 0; c < components.mean.size(); ++c)
      out.weights.row(first + k)[c] = components.basis.row(k)[c] * unit_of(components);
  return out;
}

std::optional<BodyLayers> Factorised::body_layers() const {
  return BodyLayers{background_,
                    centre_,
                    deviation_,
                    positions_.layers(),
                    shape_networks_.layers(),
                    cells_of(masks_, 0),
                    cells_of(reliefs_, masks_.basis.rows),
                    frame_.grid(),
                    nearest_m,
                    threshold_};
}

void Factorised::save(record::H5File& file) const {
  frame_.save(file);
  file.write("model/background_m", background_, {background_.size()});
  file.set("model/background_m", "threshold", double{threshold_});
  file.write("model/features_mean", centre_, {centre_.size()});
  file.write("model/features_deviation", deviation_, {deviation_.size()});
  positions_.save(file, "model/position");
  save_components(file, "model/masks", masks_);
  save_components(file, "model/reliefs", reliefs_);
  if (shapes_) shape_networks_.save(file, "model/shape");
}

void Factorised::load(const record::H5File& file, std::size_t inputs, std::size_t outputs) {
  frame_.load(file);
  background_ = file.read<float>("model/background_m", {outputs});
  threshold_ = static_cast<float>(file.get<double>("model/background_m", "threshold"));
  centre_ = file.read<float>("model/features_mean", {inputs});
  deviation_ = file.read<float>("model/features_deviation", {inputs});
  require_sound(file,
                std::all_of(deviation_.begin(), deviation_.end(), [](float d) { return d > 0; }),
                "model/features_deviation", "all above 0");
  positions_.load(file, "model/position", inputs, 2);
  masks_ = load_components(file, "model/masks", frame_.size());
  reliefs_ = load_components(file, "model/reliefs", frame_.size());
  const std::size_t shapes = masks_.basis.rows + reliefs_.basis.rows;
  if (shapes_) shape_networks_.load(file, "model/shape", inputs, shapes);
  require_sound(file, shapes_ == (shapes > 0), "model/masks", "shapes if the model has any");
}

std::unique_ptr<Model> make_factorised() { return std::make_unique<Factorised>(true); }
std::unique_ptr<Model> make_silhouette() { return std::make_unique<Factorised>(false); }

}  // namespace echofuse::recon
