// SPDX-License-Identifier: MIT
// One way from records to maps: which sensors it takes, what it learnt, and what it knows of its
// own errors. A model file holds a list of them (trained_model.hpp).
#pragma once
#include <memory>
#include <optional>
#include <string>

#include "recon/data/features.hpp"
#include "recon/data/split.hpp"
#include "recon/maps/scene.hpp"
#include "recon/method/method.hpp"
#include "recon/models/model.hpp"
#include "recon/trust/domain_shift.hpp"
#include "recon/trust/uncertainty.hpp"

namespace echofuse::recon {

struct Estimator {
  std::string name;  // its kind (model_kinds)
  Features features;
  Scene scene;
  Alignment alignment;  // not known if nothing here needs it
  std::unique_ptr<Model> model;
  std::optional<UncertaintyModel> uncertainty;  // none: no uncertainty is stated
  DomainReference domain;                       // what its training records are like
  TrainingLog log;
  FitOptions fit;
  bool knows_empty_room = false;  // trained with a run of nobody (state_empty_room)
  double train_s = 0;

  // Steps 1 and 2 of the method: the views of the rows, if the model takes them or if they are
  // wanted for what is stated; else no columns.
  Matrix views(const Dataset& data, const Rows& rows, bool wanted) const;
  // What the model takes of the rows: their views, or what features.hpp makes of them. Row i of the
  // views belongs to rows[i]; `scaled` is room for what is made.
  const Matrix& inputs(const Dataset& data, const Rows& rows, const Matrix& views,
                       Matrix& scaled) const;
  // Maps of the rows, metres.
  Matrix maps(const Dataset& data, const Rows& rows, const Matrix& views,
              SoftMaps* soft = nullptr) const;
  Matrix maps(const Dataset& data, const Rows& rows) const;
  Cost cost() const;  // with the alignment
  void archive(Archive archive);
};

// What all models of the same training rows and inputs share.
struct Preprocessing {
  Scene scene;
  Alignment alignment;   // not known unless wanted, nor without a detector
  Matrix views;          // of every record of the data set
  double elapsed_s = 0;  // which belongs to the time of each training
  Preprocessing(const Dataset& data, const Rows& train, Inputs inputs, Scene scene, bool wanted,
                const MethodConfig& config = {});
};

// Fits scaling and model to the training rows. Throws Error(usage) if the model needs both sensors.
Estimator fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                    const std::string& name, Inputs inputs, const std::string& scaling,
                    const FitOptions& options);

}  // namespace echofuse::recon
