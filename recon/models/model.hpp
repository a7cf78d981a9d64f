// SPDX-License-Identifier: MIT
// Every model learns maps from inputs, predicts them, states its cost and saves itself.
#pragma once
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "recon/metrics/scene.hpp"
#include "recon/network/training.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/tensor_file.hpp"

namespace echofuse::recon {

class Alignment;

// Inputs and depth maps of the same records, and the rows of both to use. Inputs are scaled
// (features.hpp), or aligned (method/alignment.hpp) for models that take aligned ones.
struct Samples {
  const Matrix& inputs;
  const Matrix& maps;  // metres
  Rows rows;
  const Scene* scene = nullptr;  // learnt from the training rows, for models that need it
  // Alignment that made the inputs, for models that take aligned ones; with the radar's power and
  // lags as recorded.
  const Alignment* alignment = nullptr;
  const Matrix* radar = nullptr;
  const Matrix* array = nullptr;
};

class Model {
 public:
  virtual ~Model() = default;
  virtual TrainingLog fit(const Samples& train, const Samples& validation,
                          const FitOptions& options) = 0;
  // Returns a copy of a trained model that is adapted to a few records of another room, with their
  // scene. Null if this kind of model cannot do it.
  virtual std::unique_ptr<Model> tuned(const Samples&, const Tuning&) const { return {}; }
  // A model that places a body shows this background behind it from now on; others return false.
  virtual bool show_background(std::span<const float>) { return false; }
  // Returns one map a row, in metres. Models that place a body also fill `soft`, if it is asked
  // for. Other models leave it as it is, as their mean map holds both.
  virtual Matrix predict(const Matrix& inputs, SoftMaps* soft = nullptr) const = 0;
  virtual Cost cost() const = 0;
  // Returns the options with which fit() makes a model of the same size.
  virtual FitOptions sizes() const { return {}; }
  // Writes the model, or reads and checks one of this shape (numbers/tensor_file.hpp).
  struct Shape {
    std::size_t inputs, outputs;  // values of a record, pixels of a map
    record::MapGrid grid;
  };
  virtual void archive(Archive archive, const Shape& shape) = 0;
};

// Kind of model: name, properties and maker, all that the rest of the program uses.
struct ModelKind {
  enum class Takes : std::uint8_t { nothing, inputs, aligned };  // aligned: method/alignment.hpp
  enum class Size : std::uint8_t { fixed, hidden, basis };       // meaning of a name's numbers
  std::string name;
  std::unique_ptr<Model> (*make)();
  Takes takes;
  Size size;
  FitOptions own;                  // the best options on validation records at the base condition
  const char* scaling = "record";  // scaling of the inputs (data/features.hpp)
};
// A new kind needs a row there and its own file. If `--model auto` shall try it, also a place in
// candidates() in train/crossvalidate.cpp.
const std::vector<ModelKind>& model_kinds();        // by increasing cost
const ModelKind& kind_of(const std::string& name);  // throws Error(usage)
std::vector<std::string> model_names();
std::string model_help();  // "empty, mean, ..., nearest[-N], paper (mlp-512-256)"

// Makers of the models, one a file.
std::unique_ptr<Model> make_empty_room();  // "empty": the room without anybody
std::unique_ptr<Model> make_mean();        // the mean training map
std::unique_ptr<Model> make_nearest();     // from the maps of the nearest training records
std::unique_ptr<Model> make_ridge();       // linear, penalty chosen by generalised cross-validation
std::unique_ptr<Model> make_mlp();         // the paper's plain network
std::unique_ptr<Model> make_mlp_mask();    // a network with two outputs, mask and depth
std::unique_ptr<Model> make_pca(std::unique_ptr<Model> inner);  // maps from few components
std::unique_ptr<Model> make_mean_shape();                       // the mean body, placed
std::unique_ptr<Model> make_factorised();  // place, and shape in the body's own frame

// Model of a given size, by name:
//   "mlp-1024-512-256"  hidden layers of these widths
//   "factorised-8"      8 components
//   "nearest-16"        16 neighbours
//   "paper"             the paper's network
struct Candidate {
  std::string name, model;
  FitOptions fit;
};
// Returns a candidate with every option of its kind, for this number of training records (copies
// and repetitions count). Options in `base` override them. Throws Error(usage).
Candidate candidate_of(const std::string& name, const FitOptions& base, std::size_t records = 0);

// Properties by a kind's name. Empty room and mean map ignore their inputs. Models that place a
// body take aligned inputs, with the radar's profile.
bool ignores_inputs(const std::string& name);
bool wants_alignment(const std::string& name);

}  // namespace echofuse::recon
