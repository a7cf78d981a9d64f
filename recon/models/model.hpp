// SPDX-License-Identifier: MIT
// What every model does: learn maps from inputs, predict them, state its cost, save itself.
#pragma once
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/maps/scene.hpp"
#include "recon/maps/soft_maps.hpp"
#include "recon/models/network/training.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

class Alignment;

// Inputs and depth maps of the same records, and the rows of both to use. Inputs are scaled
// (features.hpp), or aligned (method/alignment.hpp) for models that want that.
struct Samples {
  const Matrix& inputs;
  const Matrix& maps;  // metres
  Rows rows;
  const Scene* scene = nullptr;  // learnt from the training rows; of models that ask for it
  // Of models that take aligned inputs: what made them, and the radar's power and lags as they were
  // recorded.
  const Alignment* alignment = nullptr;
  const Matrix* radar = nullptr;
  const Matrix* array = nullptr;
};

class Model {
 public:
  virtual ~Model() = default;
  virtual TrainingLog fit(const Samples& train, const Samples& validation,
                          const FitOptions& options) = 0;
  // A copy of a trained model, adapted to a few records of another room, with their scene; none if
  // this kind of model cannot.
  virtual std::unique_ptr<Model> tuned(const Samples&, const Tuning&) const { return {}; }
  // Of one that places a body: what its maps show behind it from now on; others return false.
  virtual bool show_background(std::span<const float>) { return false; }
  // One map a row, metres. Models that place a body give what they are made of at once, if it is
  // asked for; others leave it as it is, as their mean map says both.
  virtual Matrix predict(const Matrix& inputs, SoftMaps* soft = nullptr) const = 0;
  virtual Cost cost() const = 0;
  // What fit() takes to make one of the same size.
  virtual FitOptions sizes() const { return {}; }
  // Writes the model, or reads and checks one of this shape (numbers/tensor_file.hpp).
  struct Shape {
    std::size_t inputs, outputs;  // values of a record, pixels of a map
    record::MapGrid grid;
  };
  virtual void archive(Archive archive, const Shape& shape) = 0;
};

// All that the rest of the program asks of a kind of model.
struct ModelKind {
  enum class Takes : std::uint8_t { nothing, inputs, aligned };  // aligned: method/alignment.hpp
  enum class Size : std::uint8_t { fixed, hidden, basis };       // what a name's numbers mean
  std::string name;
  std::unique_ptr<Model> (*make)();
  Takes takes;
  Size size;
  FitOptions own;  // what did best on validation records at the base condition
};
// To add one: a row there, its own file, and candidates() in estimator/crossvalidate.cpp if
// `--model auto` shall try it.
const std::vector<ModelKind>& model_kinds();        // by increasing cost
const ModelKind& kind_of(const std::string& name);  // throws Error(usage)
std::vector<std::string> model_names();
std::string model_help();  // "empty, mean, ..., nearest[-N], paper (mlp-512-256)"

// The models, one a file.
std::unique_ptr<Model> make_empty_room();  // "empty": the room without anybody
std::unique_ptr<Model> make_mean();        // the mean training map
std::unique_ptr<Model> make_nearest();     // from the maps of the training records nearest to it
std::unique_ptr<Model> make_ridge();       // linear, penalty chosen by generalised cross-validation
std::unique_ptr<Model> make_mlp();         // the paper's plain network
std::unique_ptr<Model> make_pca(std::unique_ptr<Model> inner);  // maps from few components
std::unique_ptr<Model> make_silhouette();                       // the mean body, placed
std::unique_ptr<Model> make_factorised();  // place, and shape in the body's own frame

// A model of a certain size: "mlp-1024-512-256" has hidden layers of these widths, "factorised-8"
// so many components, "nearest-16" so many neighbours, "paper" the paper's network.
struct Candidate {
  std::string name, model;
  FitOptions fit;
};
// With every option of its kind, for so many training records (copies and repetitions count); those
// of `base` override. Throws Error(usage).
Candidate candidate_of(const std::string& name, const FitOptions& base, std::size_t records = 0);

// Of a kind's name. The empty room and the mean map answer the same to every record; models that
// place a body take aligned inputs, with the radar's profile.
bool ignores_inputs(const std::string& name);
bool wants_alignment(const std::string& name);

}  // namespace echofuse::recon
