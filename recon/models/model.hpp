// SPDX-License-Identifier: MIT
// Interface of all models: fit, predict, report the cost, save.
#pragma once
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/metrics/scene_model.hpp"
#include "recon/network/training.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

class Alignment;

// Inputs and depth maps of the same records, and the rows to use. Inputs are scaled (features.hpp),
// or aligned (method/alignment.hpp) for models with aligned inputs.
struct Samples {
  const Matrix& inputs;
  const Matrix& maps;  // metres
  Rows rows;
  const SceneModel* scene = nullptr;  // learnt from the training rows; null if not needed
  // Alignment that made the inputs, for models with aligned inputs; radar power and lags as
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
  // Returns a copy of a trained model, adapted to a few records of another room and their scene.
  // Null if this kind of model cannot be tuned.
  virtual std::unique_ptr<Model> tuned(const Samples&, const Tuning&) const { return {}; }
  // Replaces the background behind the body; returns false for models that do not place a body.
  virtual bool show_background(std::span<const float>) { return false; }
  // Returns one map per row, in metres. Models that place a body also fill `soft` if given. Other
  // models leave it empty, because their mean map contains the same information.
  virtual Matrix predict(const Matrix& inputs, SoftMaps* soft = nullptr) const = 0;
  virtual Cost cost() const = 0;
  // Returns options with which fit() makes a model of the same size.
  virtual FitOptions sizes() const { return {}; }
  // Writes the model, or reads and checks one of this shape (numbers/tensor_file.hpp).
  struct Shape {
    std::size_t inputs, outputs;  // values per record, pixels per map
    record::MapGrid grid;
  };
  virtual void archive(Archive archive, const Shape& shape) = 0;
};

// Kind of model: all that the rest of the program needs to know about it.
struct ModelKind {
  enum class InputKind : std::uint8_t {
    nothing,
    inputs,
    aligned
  };                                                        // aligned: method/alignment.hpp
  enum class Size : std::uint8_t { fixed, hidden, basis };  // meaning of the numbers in a name
  std::string name;
  std::unique_ptr<Model> (*make)();
  InputKind takes;
  Size size;
  FitOptions own;                  // best options on validation records at the base condition
  const char* scaling = "record";  // scaling of the inputs (data/features.hpp)
};
// A new kind needs an entry there and its own file, and, for `--model auto`, an entry in
// candidates() in train/crossvalidate.cpp.
const std::vector<ModelKind>& model_kinds();        // by increasing cost
const ModelKind& kind_of(const std::string& name);  // throws Error(usage)
std::vector<std::string> model_names();
std::string model_help();  // "empty, mean, ..., nearest[-N], paper (mlp-512-256)"

// Factories of the models, one per file.
std::unique_ptr<Model> make_empty_room();  // "empty": the empty room
std::unique_ptr<Model> make_mean();        // mean training map
std::unique_ptr<Model> make_nearest();     // from the maps of the nearest training records
std::unique_ptr<Model> make_ridge();       // linear, penalty chosen by generalised cross-validation
std::unique_ptr<Model> make_mlp();         // the paper's plain network
std::unique_ptr<Model> make_mlp_mask();    // a network with two outputs, mask and depth
std::unique_ptr<Model> make_pca(std::unique_ptr<Model> inner);  // maps from few components
std::unique_ptr<Model> make_mean_shape();  // draws the mean body at the position
std::unique_ptr<Model> make_factorised();  // position, and shape in the body frame

// Model of a given size, by name:
//   "mlp-1024-512-256"  hidden layers of these widths
//   "factorised-8"      8 components
//   "nearest-16"        16 neighbours
//   "paper"             the paper's network
struct Candidate {
  std::string name, model;
  FitOptions fit;
};
// Returns a candidate with all options of its kind, for this number of training records (including
// duplicates). Options in `base` take precedence. Throws Error(usage).
Candidate candidate_of(const std::string& name, const FitOptions& base, std::size_t records = 0);

// Properties of a kind. Empty room and mean map ignore their inputs. Models that place a body use
// aligned inputs, with the radar profile.
bool ignores_inputs(const std::string& name);
bool wants_alignment(const std::string& name);

}  // namespace echofuse::recon
