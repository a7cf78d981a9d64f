// SPDX-License-Identifier: MIT
// The scene taken apart: where the body is (from the radar profile's shift against the histogram,
// the mean of a few small networks) and what it looks like there (a few masks and depths in a frame
// that moves with the body, their amounts from another network), drawn into the map. It needs both
// sensors and one thing that stands out from the background. The silhouette is the same without the
// last network: the mean body, placed.
#include <algorithm>
#include <array>
#include <cmath>

#include "acquire/record/depth_map.hpp"
#include "drivers/core/exit_code.hpp"
#include "recon/maps/scene.hpp"
#include "recon/models/body/alignment.hpp"
#include "recon/models/body/body_frame.hpp"
#include "recon/models/body/turned.hpp"
#include "recon/models/regression.hpp"
#include "recon/numbers/components.hpp"
#include "recon/numbers/statistics.hpp"

namespace echofuse::recon {
namespace {

constexpr std::size_t least_shape_hidden = 16;
const std::vector<std::size_t> position_hidden = {48, 48};
// The depth is nearly known from the range: a network that cares for both learns less of the side.
const std::vector<float> position_weights = {1, 0.1f};
constexpr float nearest_m = 0.1f;                  // that a body is taken to be
constexpr std::size_t position_networks = 3;       // trained apart: their mean errs less than each
constexpr std::uint64_t turn_stream = 0x7475726e;  // "turn"
// For the components of the bodies; more records hardly turn them.
constexpr std::size_t most_bodies = 3000;

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

std::string position_group(std::size_t network) {
  return "model/position" + std::to_string(network);
}

// Of the amounts of each kind, so that neither drowns the other.
float unit_of(const Components& components) {
  return std::max(components.deviation.front(), 1e-6f);
}

class Factorised final : public Model {
 public:
  explicit Factorised(bool shapes) : shapes_(shapes) {}
  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override;
  Matrix predict(const Matrix& aligned, SoftMaps* soft) const override;
  Cost cost() const override;
  std::optional<BodyLayers> body_layers() const override;
  void save(record::H5File& file) const override;
  void load(const record::H5File& file, std::size_t inputs, std::size_t outputs) override;

 private:
  // Records with a body in both the inputs and the map.
  struct Seen {
    Matrix features;  // not yet standardised
    Rows rows;        // of the samples
    std::vector<Place> places;
  };
  struct Shapes {
    Matrix masks, reliefs;
  };
  Seen see(const Samples& samples) const;
  Matrix look(const Matrix& aligned, Rows& with_body) const;
  void learn_scale(const Matrix& features);
  void standardise(std::span<float> features) const;
  float range_of(std::span<const float> standardised) const;  // metres
  TrainingLog fit_position(const Seen& train, const Samples& samples, const Seen& validation,
                           const FitOptions& options);
  void fit_bodies(const Seen& train, const Samples& samples, const FitOptions& options);
  bool fit_shape(const Seen& train, const Samples& train_samples, const Seen& validation,
                 const Samples& validation_samples, const FitOptions& options);
  Shapes cut(const Seen& seen, const Samples& samples, std::size_t most) const;
  Matrix amounts(const Seen& seen, const Samples& samples) const;
  void choose_threshold(const Seen& seen, const Samples& samples);
  std::vector<Place> find_places(const Matrix& features) const;
  Shapes find_shapes(const Matrix& features) const;
  std::vector<AffineLayer> layers_of(const Components& components, std::size_t first) const;

  bool shapes_;
  std::vector<float> background_;          // metres
  std::vector<float> centre_, deviation_;  // of the features
  std::vector<Regression> positions_;      // whose mean counts
  Regression shape_;
  BodyFrame frame_;
  Components masks_, reliefs_;
  float threshold_ = 0.5f;
};

Factorised::Seen Factorised::see(const Samples& samples) const {
  Seen out;
  out.features.cols = samples.inputs.cols;
  for (const std::size_t row : samples.rows) {
    const auto place = place_of(samples.maps.row(row), background_);
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
  deviation_.assign(features.cols, 1);
  for (std::size_t c = 0; c < features.cols; ++c)
    if (columns.variance[c] > 0) deviation_[c] = static_cast<float>(std::sqrt(columns.variance[c]));
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
  TrainingLog log = fit_position(seen, train, judged, options);
  fit_bodies(seen, train, options);
  if (shapes_) log.interrupted |= fit_shape(seen, train, judged, validation, options);
  if (judged.rows.empty())
    choose_threshold(seen, train);
  else
    choose_threshold(judged, validation);
  return log;
}

// Each network has weights, order and turns of its own; the log is of the last one. Judged by
// records as they are.
TrainingLog Factorised::fit_position(const Seen& train, const Samples& samples,
                                     const Seen& validation, const FitOptions& options) {
  const auto targets = [&](const Seen& seen) {
    Matrix out(0, 2);
    for (std::size_t i = 0; i < seen.rows.size(); ++i)
      out.add_row(position_target(seen.places[i], range_of(seen.features.row(i))));
    return out;
  };
  const Matrix wanted = targets(train), judged = targets(validation);
  const Rows rows = all_rows(train.rows.size()), judged_rows = all_rows(validation.rows.size());
  Training training = training_of(options);
  training.hidden = position_hidden, training.weights = position_weights;
  Rng rng;
  const TurnedBodies turned(*samples.alignment, samples.inputs, *samples.radar, train.rows,
                            train.places);
  if (turned.baseline_m() != 0)
    training.redraw = [&](std::span<const std::size_t> batch, Matrix& inputs, Matrix& places) {
      for (std::size_t i = 0; i < batch.size(); ++i) {
        const Place place = turned.turn(batch[i], rng, inputs.row(i));
        const auto target = position_target(place, inputs.row(i).back());
        std::copy(target.begin(), target.end(), places.row(i).begin());
        standardise(inputs.row(i));
      }
    };
  TrainingLog log;
  positions_.clear();
  while (positions_.size() < position_networks && !log.interrupted) {
    rng = make_rng(training.seed, turn_stream);
    log = positions_.emplace_back().fit({train.features, wanted, rows},
                                        {validation.features, judged, judged_rows}, Spread::each,
                                        training, "position", " of the spread");
    training.seed = mix(training.seed);
  }
  return log;
}

void Factorised::fit_bodies(const Seen& train, const Samples& samples, const FitOptions& options) {
  frame_ = BodyFrame(samples.maps, background_, train.rows, train.places);
  const std::size_t basis = shapes_ ? options.basis.value() : 0;
  Shapes bodies = cut(train, samples, most_bodies);
  masks_ = principal_components(std::move(bodies.masks), basis, options.seed);
  reliefs_ = principal_components(std::move(bodies.reliefs), (basis + 1) / 2, options.seed + 1);
}

// True if it was interrupted.
bool Factorised::fit_shape(const Seen& train, const Samples& train_samples, const Seen& validation,
                           const Samples& validation_samples, const FitOptions& options) {
  Training training = training_of(options);
  const std::size_t width = std::max(2 * masks_.basis.rows, least_shape_hidden);
  training.hidden = {width, width};
  return shape_
      .fit({train.features, amounts(train, train_samples), all_rows(train.rows.size())},
           {validation.features, amounts(validation, validation_samples),
            all_rows(validation.rows.size())},
           Spread::common, training, "shape", " of the spread")
      .interrupted;
}

Factorised::Shapes Factorised::cut(const Seen& seen, const Samples& samples,
                                   std::size_t most) const {
  const std::size_t count = std::min(seen.rows.size(), most);
  Shapes out{Matrix(count, frame_.size()), Matrix(count, frame_.size())};
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t from = i * seen.rows.size() / count;
    frame_.cut(samples.maps.row(seen.rows[from]), background_, seen.places[from], out.masks.row(i),
               out.reliefs.row(i));
  }
  return out;
}

// How much of each component a body has, masks first; both kinds in units of their strongest one.
Matrix Factorised::amounts(const Seen& seen, const Samples& samples) const {
  const Shapes bodies = cut(seen, samples, seen.rows.size());
  const Matrix of_masks = coordinates(masks_, bodies.masks);
  const Matrix of_reliefs = coordinates(reliefs_, bodies.reliefs);
  Matrix out(seen.rows.size(), of_masks.cols + of_reliefs.cols);
  const auto put = [&](const Matrix& from, const Components& components, std::size_t first) {
    const float unit = unit_of(components);
    for (std::size_t i = 0; i < out.rows; ++i)
      for (std::size_t k = 0; k < from.cols; ++k) out.row(i)[first + k] = from.row(i)[k] / unit;
  };
  put(of_masks, masks_, 0);
  put(of_reliefs, reliefs_, of_masks.cols);
  return out;
}

std::vector<Place> Factorised::find_places(const Matrix& features) const {
  Matrix found(features.rows, 2);
  for (const Regression& position : positions_) {
    const Matrix one = position.predict(features);
    for (std::size_t i = 0; i < one.values.size(); ++i)
      found.values[i] += one.values[i] / static_cast<float>(positions_.size());
  }
  std::vector<Place> out;
  for (std::size_t i = 0; i < found.rows; ++i) {
    const float range_m = range_of(features.row(i));
    out.push_back({found.row(i)[0] / std::max(range_m, nearest_m),
                   std::max(range_m + found.row(i)[1], nearest_m)});
  }
  return out;
}

Factorised::Shapes Factorised::find_shapes(const Matrix& features) const {
  const Matrix found = shapes_ ? shape_.predict(features) : Matrix(features.rows, 0);
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
      frame_.draw(shapes.masks.row(i), shapes.reliefs.row(i), places[i],
                  static_cast<float>(percent) / 100, background_, map);
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
  Matrix out(aligned.rows, background_.size());
  if (soft) *soft = {Matrix(out.rows, out.cols), Matrix(out.rows, out.cols)};
  for (std::size_t i = 0; i < out.rows; ++i) {
    if (shows_body(aligned.row(i))) continue;
    std::copy(background_.begin(), background_.end(), out.row(i).begin());
    if (soft) std::copy(background_.begin(), background_.end(), soft->depth.row(i).begin());
  }
  Rows with_body;
  const Matrix features = look(aligned, with_body);
  if (with_body.empty()) return out;
  const std::vector<Place> places = find_places(features);
  const Shapes shapes = find_shapes(features);
  for (std::size_t i = 0; i < with_body.size(); ++i) {
    const auto mask = shapes.masks.row(i), relief = shapes.reliefs.row(i);
    const std::size_t row = with_body[i];
    frame_.draw(mask, relief, places[i], threshold_, background_, out.row(row));
    if (soft)
      frame_.draw_soft(mask, relief, places[i], soft->foreground_probability.row(row),
                       soft->depth.row(row));
  }
  return out;
}

Cost Factorised::cost() const {
  const std::size_t basis = masks_.basis.values.size() + reliefs_.basis.values.size();
  Cost out{basis + frame_.draw_cost(), basis + masks_.mean.size() + reliefs_.mean.size() +
                                           2 * centre_.size() + background_.size()};
  const auto add = [&](const Cost& cost) {
    out.multiply_adds += cost.multiply_adds, out.parameters += cost.parameters;
  };
  for (const Regression& position : positions_) add(position.cost());
  add(shape_.cost());
  return out;
}

// To the cells of one kind, whose amounts begin with this output of the shape network.
std::vector<AffineLayer> Factorised::layers_of(const Components& components,
                                               std::size_t first) const {
  auto out =
      shapes_ ? shape_.layers() : std::vector<AffineLayer>{{Matrix(centre_.size(), 1), {0}, false}};
  AffineLayer cells{Matrix(out.back().biases.size(), components.mean.size()), components.mean};
  for (std::size_t k = 0; k < components.basis.rows; ++k)
    for (std::size_t c = 0; c < components.mean.size(); ++c)
      cells.weights.row(first + k)[c] = components.basis.row(k)[c] * unit_of(components);
  out.push_back(std::move(cells));
  return out;
}

std::optional<BodyLayers> Factorised::body_layers() const {
  BodyLayers out{background_,   centre_, deviation_, {},        nearest_m,
                 frame_.grid(), {},      {},         threshold_};
  for (const Regression& position : positions_) out.positions.push_back(position.layers());
  out.masks = layers_of(masks_, 0), out.reliefs = layers_of(reliefs_, masks_.basis.rows);
  return out;
}

void Factorised::save(record::H5File& file) const {
  frame_.save(file);
  file.write("model/background_m", background_, {background_.size()});
  file.set("model/background_m", "threshold", double{threshold_});
  file.write("model/features_mean", centre_, {centre_.size()});
  file.write("model/features_deviation", deviation_, {deviation_.size()});
  for (std::size_t n = 0; n < positions_.size(); ++n) positions_[n].save(file, position_group(n));
  save_components(file, "model/masks", masks_);
  save_components(file, "model/reliefs", reliefs_);
  if (shapes_) shape_.save(file, "model/shape");
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
  positions_.clear();
  for (std::size_t n = 0; n == 0 || file.has(position_group(n)); ++n)
    positions_.emplace_back().load(file, position_group(n), inputs, 2);
  masks_ = load_components(file, "model/masks", frame_.size());
  reliefs_ = load_components(file, "model/reliefs", frame_.size());
  const std::size_t shapes = masks_.basis.rows + reliefs_.basis.rows;
  if (shapes_) shape_.load(file, "model/shape", inputs, shapes);
  require_sound(file, shapes_ == (shapes > 0), "model/masks", "shapes if the model has any");
}

}  // namespace

std::unique_ptr<Model> make_factorised() { return std::make_unique<Factorised>(true); }
std::unique_ptr<Model> make_silhouette() { return std::make_unique<Factorised>(false); }

}  // namespace echofuse::recon
