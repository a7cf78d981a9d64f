// SPDX-License-Identifier: MIT
// The scene taken apart: where the body is (from the radar profile's shift against the histogram)
// and what it looks like there (a few masks and depths in a frame that moves with the body), drawn
// into the map. The place and the amounts of the shapes come from small networks. It needs both
// sensors and one thing that stands out from the background. The silhouette is the same without the
// last network: the mean body, placed.
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "recon/models/body/body_frame.hpp"
#include "recon/models/body/turned.hpp"
#include "recon/models/ensemble.hpp"
#include "recon/numbers/components.hpp"

namespace echofuse::recon {

class Factorised final : public Model {
 public:
  explicit Factorised(bool shapes) : shapes_(shapes) {}
  TrainingLog fit(const Samples& train, const Samples& validation,
                  const FitOptions& options) override;
  std::unique_ptr<Model> tuned(const Samples& train, const Tuning& tuning) const override;
  bool show_background(std::span<const float> metres) override {
    background_.assign(metres.begin(), metres.end());
    return true;
  }
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
  // Of a turned body: its place, its range (metres) and the targets to put in.
  using Retarget = std::function<void(const Place&, float, std::span<float>)>;
  Redraw turning(const TurnedBodies& turned, const Retarget& retarget) const;
  Redraw turning_places(const TurnedBodies& turned) const;
  Redraw turning_shapes(const TurnedBodies& turned) const;
  Matrix position_targets(const Seen& seen) const;
  TrainingLog fit_position(const Seen& train, const TurnedBodies& turned, const Seen& validation,
                           const FitOptions& options);
  void fit_bodies(const Seen& train, const Samples& samples, const FitOptions& options);
  bool fit_shape(const Seen& train, const Samples& train_samples, const TurnedBodies& turned,
                 const Seen& validation, const Samples& validation_samples,
                 const FitOptions& options);
  // Of the given ones of the records seen.
  Shapes cut(const Seen& seen, const Samples& samples, const Rows& which) const;
  Matrix amounts(const Seen& seen, const Samples& samples) const;
  void move_mean_body(const Seen& seen, const Samples& samples);
  void choose_threshold(const Seen& seen, const Samples& samples);
  std::vector<Place> find_places(const Matrix& features) const;
  Shapes find_shapes(const Matrix& features) const;
  AffineLayer cells_of(const Components& components, std::size_t first) const;

  bool shapes_;
  std::vector<float> background_;          // metres
  std::vector<float> centre_, deviation_;  // of the features
  Ensemble positions_, shape_networks_;
  BodyFrame frame_;
  Components masks_, reliefs_;
  float threshold_ = 0.5f;
};

}  // namespace echofuse::recon
