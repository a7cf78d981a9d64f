// SPDX-License-Identifier: MIT
// Factorised model: position and appearance of a body are estimated separately. Position: from the
// shift of the radar profile against the histogram, or from the detector's zones. Appearance: a few
// components of masks and depths in a frame that moves with the body, drawn into the map. Small
// networks estimate position and coefficients. Needs the radar or zones, and one body in front of
// the background. The mean-shape model has no appearance network: it draws the mean body.
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "recon/method/method.hpp"
#include "recon/method/rotation.hpp"
#include "recon/models/model.hpp"

namespace echofuse::recon {

class Factorised final : public Model {
 public:
  explicit Factorised(bool shapes) { model_.has_shapes = shapes; }
  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override;
  std::unique_ptr<Model> tuned(const Samples& train, const Tuning& tuning) const override;
  bool show_background(std::span<const float> metres) override {
    model_.background.assign(metres.begin(), metres.end());
    return true;
  }
  Matrix predict(const Matrix& views, SoftMaps* soft) const override {
    return reconstruct(views, model_, soft);
  }
  Cost cost() const override { return recon::cost(model_); }
  FitOptions sizes() const override;
  void archive(Archive archive, const Shape& shape) override {
    model_.archive(archive, shape.inputs, shape.grid);
  }

 private:
  // Records with a body in both view and map.
  struct Bodies {
    Matrix views;  // not yet standardised
    Rows rows;     // rows of the samples
    std::vector<Place> places;
  };
  Bodies bodies_in(const Samples& samples) const;
  void learn_scale(const Matrix& views);
  // Called for a rotated body with its position, its range (m) and the targets to write.
  using Retarget = std::function<void(const Place&, float, std::span<float>)>;
  Redraw augment(const RotatedBodies& rotated, const Retarget& retarget) const;
  Redraw augment_positions(const RotatedBodies& rotated) const;
  Redraw augment_shapes(const RotatedBodies& rotated) const;
  Matrix position_targets(const Bodies& bodies) const;
  TrainingLog fit_position(const Bodies& train, const RotatedBodies& rotated,
                           const Bodies& validation, const FitOptions& options);
  void fit_components(const Bodies& train, const Samples& samples, const FitOptions& options);
  bool fit_shape(const Bodies& train, const Samples& train_samples, const RotatedBodies& rotated,
                 const Bodies& validation, const Samples& validation_samples,
                 const FitOptions& options);
  // Cuts these bodies out of the maps, in the body frame.
  Shapes cut(const Bodies& bodies, const Samples& samples, const Rows& which) const;
  Matrix amounts(const Bodies& bodies, const Samples& samples) const;
  void move_mean_body(const Bodies& bodies, const Samples& samples);
  void choose_threshold(const Bodies& bodies, const Samples& samples);

  BodyModel model_;
};

}  // namespace echofuse::recon
