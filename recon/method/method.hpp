// SPDX-License-Identifier: MIT
// The method has six steps (method.cpp reads from top to bottom):
//
//   Matrix o = observe(data, rows, sensors);     // [n x values]  counts | power | lags | zones
//   Matrix v = align(o, scene);                  // [n x inputs]  relative to the body's range
//   BodyViews b = body_views(v, model);          // m <= n        views with a body, standardised
//   auto p = place(b.views, model);              // m             positions of the bodies
//   Shapes s = shape(b.views, model);            // [m x cells]   masks and depths
//   draw(p, s, model, b.rows, maps);             // [n x pixels]  metres, over the background
//
// Step six, trust, estimates the error of each map and tests whether its record resembles the
// training data. It works with every kind of model (UncertaintyModel::trust() in
// trust/uncertainty.hpp). Rows are records. The networks are trained elsewhere
// (models/factorised.hpp).
#pragma once
#include <span>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/method/body_frame.hpp"
#include "recon/metrics/scene_model.hpp"
#include "recon/network/ensemble.hpp"
#include "recon/numbers/components.hpp"

namespace echofuse::recon {

// Step 1: returns the values that `sensors` requests, [n x sensors.layout().inputs()], for each of
// the n rows. These are the number of photons per bin (corrected for pile-up), the linear radar
// power per bin (after the range offset is subtracted), the spatial lags of the radar antennas per
// bin (data/lags.hpp), and the number of photons per bin of each zone.
Matrix observe(const Dataset& data, const Rows& rows, const Features& sensors);

// Step 2: returns the views, [n x scene.inputs()]: correlation between the two sensors for each
// range shift | histogram | zones | profile | antennas | range in metres. If a record shows no
// body, its view is zero.
Matrix align(const Matrix& observations, const Alignment& scene);
// Aligns one record. `view` has scene.inputs() values.
void align(std::span<const float> observation, const Alignment& scene, std::span<float> view);

// Learnt parameters of steps 3 to 5.
struct BodyModel {
  std::vector<float> background;  // [pixels] depth map of the empty room, m
  // [inputs] mean and scale of each input over the training records' views
  std::vector<float> centre, deviation;
  Ensemble place;  // networks that predict lateral position (m) and depth minus range (m)
  // Networks that predict the mask coefficients, followed by the depth coefficients.
  Ensemble shape;
  // Principal components of the masks and depths of bodies in the body frame, [components x cells].
  Components masks, depths;
  BodyFrame frame;         // grid that moves with the body
  float nearest_m = 0.1f;  // minimum distance of a body, m
  float threshold = 0.5f;  // pixels with a mask above this threshold belong to the body
  bool has_shapes = true;  // false: the mean body is always drawn

  void archive(Archive archive, std::size_t inputs, const record::MapGrid& grid);
};

// Replaces a view by (view - centre) / deviation, the input of the networks.
void standardise(std::span<float> view, const BodyModel& model);

// Standardised views of those m of the n records that show a body.
struct BodyViews {
  Matrix views;  // [m x inputs]
  Rows rows;     // row of each view among the n records
};
BodyViews body_views(const Matrix& views, const BodyModel& model);

// Extracts the range of the body, m, from a standardised view.
float range_of(std::span<const float> standard_view, const BodyModel& model);
// Returns the number of multiply-adds needed to convert a view to a map, and the number of
// parameters of the model.
Cost cost(const BodyModel& model);

// Step 3: returns the positions of the bodies, estimated from m standardised views.
std::vector<Place> place(const Matrix& standard_views, const BodyModel& model);

// Step 4: returns two tables [m x cells]. masks: fraction of each cell that belongs to the body.
// depths: that fraction times the depth relative to the body's position, m.
struct Shapes {
  Matrix masks, depths;
};
Shapes shape(const Matrix& standard_views, const BodyModel& model);

// Step 5: draws the bodies into the maps of these rows, [n x pixels] in metres, which must contain
// the background. If `soft` is not null, it receives the foreground probability and the body depth
// of each pixel.
void draw(const std::vector<Place>& places, const Shapes& shapes, const BodyModel& model,
          const Rows& rows, Matrix& maps, SoftMaps* soft = nullptr);

// Runs steps 3 to 5 for n views, and returns the maps, [n x pixels] in metres.
Matrix reconstruct(const Matrix& views, const BodyModel& model, SoftMaps* soft = nullptr);

}  // namespace echofuse::recon
