// SPDX-License-Identifier: MIT
// Estimator: model for a set of sensors, with preprocessing, parameters and error statistics. A
// model file contains a list of estimators (trained_model.hpp).
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "recon/data/features.hpp"
#include "recon/data/split.hpp"
#include "recon/method/method.hpp"
#include "recon/metrics/scene_model.hpp"
#include "recon/models/model.hpp"
#include "recon/trust/domain_shift.hpp"
#include "recon/trust/uncertainty.hpp"

namespace echofuse::recon {

struct Estimator {
  std::string name;  // name of its kind (model_kinds)
  Features features;
  SceneModel scene;
  Alignment alignment;  // unused: empty
  std::unique_ptr<Model> model;
  std::optional<UncertaintyModel> uncertainty;  // empty: states no uncertainty
  DomainReference domain;                       // statistics of its training records
  TrainingLog log;
  FitOptions fit;
  bool knows_empty_room = false;  // true if trained with a run of the empty room (state_empty_room)
  double train_s = 0;

  // Returns the views of the rows (steps 1 and 2 of the method). No columns unless the model uses
  // them or they are `wanted` for the uncertainty.
  Matrix views(const Dataset& data, const Rows& rows, bool wanted) const;
  // Returns the model's inputs of the rows: their views, or features (features.hpp). Row i of the
  // views belongs to rows[i]. `scaled` is scratch memory.
  const Matrix& inputs(const Dataset& data, const Rows& rows, const Matrix& views,
                       Matrix& scaled) const;
  // Returns the maps of the rows, in metres.
  Matrix maps(const Dataset& data, const Rows& rows, const Matrix& views,
              SoftMaps* soft = nullptr) const;
  Matrix maps(const Dataset& data, const Rows& rows) const;
  Cost cost() const;  // including the alignment
  void archive(Archive archive);
};

// Shared by all models with the same training rows and inputs.
struct Preprocessing {
  SceneModel scene;
  Alignment alignment;   // empty unless wanted; also empty without a detector
  Matrix views;          // views of all records of the data set
  double elapsed_s = 0;  // counted in the time of each training
  Preprocessing(const Dataset& data, const Rows& train, Inputs inputs, SceneModel scene,
                bool wanted);
};

// Fits scaling and model to the training rows. scaling "record" selects the default of the model's
// kind. Throws Error(usage) if the model needs both sensors, or zones.
Estimator fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                    const std::string& name, Inputs inputs, const std::string& scaling,
                    const FitOptions& options);

}  // namespace echofuse::recon
