// SPDX-License-Identifier: MIT
// Estimator: one way from records to maps, with its sensors, its parameters, and the statistics of
// its errors. A model file holds a list of estimators (trained_model.hpp).
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "recon/data/features.hpp"
#include "recon/data/split.hpp"
#include "recon/method/method.hpp"
#include "recon/metrics/scene.hpp"
#include "recon/models/model.hpp"
#include "recon/trust/domain_shift.hpp"
#include "recon/trust/uncertainty.hpp"

namespace echofuse::recon {

struct Estimator {
  std::string name;  // its kind (model_kinds)
  Features features;
  Scene scene;
  Alignment alignment;  // empty if nothing here needs it
  std::unique_ptr<Model> model;
  std::optional<UncertaintyModel> uncertainty;  // if empty, no uncertainty is stated
  DomainReference domain;                       // the numbers of its training records
  TrainingLog log;
  FitOptions fit;
  bool knows_empty_room = false;  // true if it was trained with a run of nobody (state_empty_room)
  double train_s = 0;

  // Returns the views of the rows (steps 1 and 2 of the method). Without columns, unless the model
  // takes them or they are `wanted` for the uncertainty.
  Matrix views(const Dataset& data, const Rows& rows, bool wanted) const;
  // Returns the model's inputs of the rows: their views, or what features.hpp makes of them. Row i
  // of the views belongs to rows[i]. `scaled` is scratch memory.
  const Matrix& inputs(const Dataset& data, const Rows& rows, const Matrix& views,
                       Matrix& scaled) const;
  // Returns the maps of the rows, in metres.
  Matrix maps(const Dataset& data, const Rows& rows, const Matrix& views,
              SoftMaps* soft = nullptr) const;
  Matrix maps(const Dataset& data, const Rows& rows) const;
  Cost cost() const;  // includes the alignment
  void archive(Archive archive);
};

// Shared by all models of the same training rows and inputs.
struct Preprocessing {
  Scene scene;
  Alignment alignment;   // empty unless wanted, and without a detector
  Matrix views;          // views of every record of the data set
  double elapsed_s = 0;  // belongs to the time of each training
  Preprocessing(const Dataset& data, const Rows& train, Inputs inputs, Scene scene, bool wanted);
};

// Fits scaling and model to the training rows. The scaling "record" stands for the kind's own.
// Throws Error(usage) if the model needs both sensors, or zones.
Estimator fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                    const std::string& name, Inputs inputs, const std::string& scaling,
                    const FitOptions& options);

}  // namespace echofuse::recon
