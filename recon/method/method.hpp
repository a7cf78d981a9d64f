// SPDX-License-Identifier: MIT
// The method has six steps (method.cpp reads from top to bottom):
//
//   Matrix o = observe(data, rows, sensors);  // [n x values]  counts | power | lags | zones
//   Matrix v = align(o, scene);               // [n x inputs]  the same, about the range
//   Seen b = seen(v, model);                  // m <= n        views of bodies, standardised
//   auto p = place(b.views, model);           // m             where they stand
//   Shapes s = shape(b.views, model);         // [m x cells]   their masks and depths
//   draw(p, s, model, b.rows, maps);          // [n x pixels]  metres, before the background
//
// The sixth, trust, says how far off each map may be, and whether its record is like the training:
// UncertaintyModel::trust() in trust/uncertainty.hpp, which serves every kind of model.
// A record is a row throughout. The networks are learnt elsewhere (models/factorised.hpp).
#pragma once
#include <span>
#include <vector>

#include "recon/data/features.hpp"
#include "recon/method/alignment.hpp"
#include "recon/method/body_frame.hpp"
#include "recon/metrics/scene.hpp"
#include "recon/network/ensemble.hpp"
#include "recon/numbers/components.hpp"

namespace echofuse::recon {

// Step 1 gives for each of the n rows: photons a bin (pile-up corrected), linear power a bin at
// true ranges, and spatial lags a bin of the radar's antennas (data/lags.hpp), as far as `sensors`
// asks for them. The photons of each zone of the detector follow. The result is
// [n x sensors.layout().inputs()]. Throws as require_zones.
Matrix observe(const Dataset& data, const Rows& rows, const Features& sensors);

// Step 2 gives the view of each body, [n x scene.inputs()]: correlation of both sensors over their
// shift | histogram | zones | profile | antennas | range in metres. A row without a body is all
// zero.
Matrix align(const Matrix& observations, const Alignment& scene);
// Aligns one row.
void align(std::span<const float> observation, const Alignment& scene, std::span<float> view);

// Training learns these values for steps 3 to 5.
struct BodyModel {
  std::vector<float> background;         // [pixels] the room without anybody, metres
  std::vector<float> centre, deviation;  // [inputs] of the views of the training records
  Ensemble place;                        // inputs -> metres to the right, metres behind the range
  Ensemble shape;                        // inputs -> amounts of masks, then of depths
  Components masks, depths;  // [components x cells] principal components of bodies in their frame
  BodyFrame frame;           // places of the cells about a body
  float nearest_m = 0.1f;    // no body is taken to be nearer
  float threshold = 0.5f;    // threshold of the mask: above it a pixel shows the body
  bool has_shapes = true;    // if false, each body looks like the mean one

  void archive(Archive archive, std::size_t inputs, const record::MapGrid& grid);
};

// Computes (view - centre) / deviation in place; the networks take the result.
void standardise(std::span<float> view, const BodyModel& model);

// Views that show a body, standardised, and their rows.
struct Seen {
  Matrix views;  // [m x inputs], m <= n
  Rows rows;     // their rows among the n
};
Seen seen(const Matrix& views, const BodyModel& model);

// Returns the range of a standardised view, in metres.
float range_of(std::span<const float> standard_view, const BodyModel& model);
// Returns the multiply-adds of one map from its view, and the number of parameters.
Cost cost(const BodyModel& model);

// Step 3 places m views that show a body.
std::vector<Place> place(const Matrix& standard_views, const BodyModel& model);

// Step 4 gives two tables, [m x cells] each: the share of a cell that is body, and that share times
// how far the body lies behind its place there (metres).
struct Shapes {
  Matrix masks, depths;
};
Shapes shape(const Matrix& standard_views, const BodyModel& model);

// Step 5 draws into the maps of the given rows, which show the background: [n x pixels], metres. If
// `soft` is not null, it gets each pixel's share of body and its depth.
void draw(const std::vector<Place>& places, const Shapes& shapes, const BodyModel& model,
          const Rows& rows, Matrix& maps, SoftMaps* soft = nullptr);

// Runs steps 3 to 5 for n views; returns [n x pixels].
Matrix reconstruct(const Matrix& views, const BodyModel& model, SoftMaps* soft = nullptr);

}  // namespace echofuse::recon
