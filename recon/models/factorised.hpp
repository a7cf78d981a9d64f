// SPDX-License-Identifier: MIT
// Factorised model: small networks estimate the position and the shape of a body separately. The
// position is estimated from the shift between the radar profile and the histogram, or from the
// zones of the detector. The shape is a sum of a few components of masks and depths, in a frame
// that moves with the body, and is drawn into the map. The model requires the radar or zones, and
// one body in front of the background. The mean-shape model has no shape network: it always draws
// the mean body.
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
  struct Bodies : SeenBodies {
    Matrix views;  // views of these rows, not yet standardised
  };
  Bodies bodies_in(const Samples& samples) const;
  void learn_scale(const Matrix& views);
  // Writes the targets of a rotated body. Arguments: the position of the body, its range in m, and
  // the targets to be written.
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
  // Returns the masks and depths of the bodies selected by `which`, in the body frame.
  Shapes cut(const Bodies& bodies, const Samples& samples, const Rows& which) const;
  Matrix amounts(const Bodies& bodies, const Samples& samples) const;
  void move_mean_body(const Bodies& bodies, const Samples& samples);
  void choose_threshold(const Bodies& bodies, const Samples& samples);

  BodyModel model_;
};

}  // namespace echofuse::recon
