// SPDX-License-Identifier: MIT
// Fine-tunes the factorised model for another room. Its networks are trained further, and its mean
// body is moved towards that of the new records. Components, threshold and scaling do not change.
#include "recon/method/method.hpp"
#include "recon/models/factorised.hpp"

namespace echofuse::recon {
namespace {

// Factor by which the L2 penalty is multiplied for shapes, because shapes have more degrees of
// freedom than positions.
constexpr double shape_penalty = 10;

void move_mean(Components& components, const Matrix& seen, const Matrix& found) {
  const auto share =
      static_cast<float>(Tuning::shrinkage(seen.rows)) / static_cast<float>(seen.rows);
  for (std::size_t i = 0; i < seen.rows; ++i)
    for (std::size_t c = 0; c < seen.cols; ++c)
      components.mean[c] += share * (seen.row(i)[c] - found.row(i)[c]);
}

}  // namespace

std::unique_ptr<Model> Factorised::tuned(const Samples& train, const Tuning& tuning) const {
  auto out = std::make_unique<Factorised>(*this);
  out->model_.background = train.scene->background;
  if (tuning.networks_stay() && !tuning.correct) return out;
  Bodies seen = out->bodies_in(train);
  if (seen.rows.empty()) return out;
  for (std::size_t i = 0; i < seen.views.rows; ++i) standardise(seen.views.row(i), model_);
  const Rows rows = all_rows(seen.rows.size());
  if (tuning.networks_stay()) {
    out->model_.place.correct({seen.views, position_targets(seen), rows});
    out->move_mean_body(seen, train);
    return out;
  }
  Training training = training_of(tuning, rows.size());
  out->model_.place.tune({seen.views, position_targets(seen), rows}, training, "position");
  out->move_mean_body(seen, train);
  if (!model_.has_shapes) return out;
  training.l2_penalty *= shape_penalty;
  out->model_.shape.tune({seen.views, out->amounts(seen, train), rows}, training, "shape");
  return out;
}

void Factorised::move_mean_body(const Bodies& seen, const Samples& samples) {
  const Shapes bodies = cut(seen, samples, all_rows(seen.rows.size())),
               found = shape(seen.views, model_);
  move_mean(model_.masks, bodies.masks, found.masks);
  move_mean(model_.depths, bodies.depths, found.depths);
}

}  // namespace echofuse::recon
