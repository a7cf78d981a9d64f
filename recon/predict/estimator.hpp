// SPDX-License-Identifier: MIT
// Estimator: a model for one set of sensors, with its preprocessing, parameters and error
// statistics. A model file contains a list of estimators (trained_model.hpp).
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
  std::string name;  // kind of model, see model_kinds()
  Features features;
  SceneModel scene;
  Alignment alignment;  // background and alignment of the inputs; empty if not used
  std::unique_ptr<Model> model;
  std::optional<UncertaintyModel> uncertainty;  // empty if the model is not calibrated
  DomainReference domain;                       // statistics of the training records
  TrainingLog log;
  FitOptions fit;
  bool has_empty_room = false;  // true: the training data contained an empty-room run
  double train_s = 0;

  // Returns the views of the given records (steps 1 and 2 in method.hpp), one per row. The result
  // has no columns if the model does not use views and `needed` is false. `needed` is true if
  // the error estimate needs the views.
  Matrix views(const Dataset& data, const Rows& rows, bool needed) const;
  // Returns the model's inputs for the given records: `views`, or features (features.hpp) if the
  // model does not use views. Row i of `views` belongs to rows[i]. The result may refer
  // to `scaled`.
  const Matrix& inputs(const Dataset& data, const Rows& rows, const Matrix& views,
                       Matrix& scaled) const;
  // Returns the predicted depth map for each row, in metres.
  Matrix maps(const Dataset& data, const Rows& rows, const Matrix& views,
              SoftMaps* soft = nullptr) const;
  Matrix maps(const Dataset& data, const Rows& rows) const;
  Cost cost() const;  // returns the cost of predicting one map, including the alignment
  void archive(Archive archive);
};

std::vector<float> mean_observation(const Dataset& data, const Features& sensors);

// Results of preprocessing, shared by all models with the same training rows and inputs.
struct Preprocessing {
  SceneModel scene;
  Alignment alignment;  // empty if alignment was not requested or SPD data are missing
  Matrix views;
  double elapsed_s = 0;  // duration, included in the training time of each model
  bool has_empty_room;
  // `empty`: records of the room without people, on the axes of `data`; no records if unknown.
  Preprocessing(const Dataset& data, const Rows& train, Inputs inputs, SceneModel scene,
                bool needed, const Dataset& empty = {});
};

// Fits the input scaling and the model to the training rows. The scaling "record" selects the
// default scaling of the model kind. Throws Error(usage) if the model needs both sensors, or a
// detector with zones, but the data do not contain these.
Estimator fit_model(const Dataset& data, const Split& split, const Preprocessing& preprocessing,
                    const std::string& name, Inputs inputs, const std::string& scaling,
                    const FitOptions& options);

}  // namespace echofuse::recon
