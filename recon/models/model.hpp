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

#include "acquire/record/h5.hpp"
#include "recon/maps/scene.hpp"
#include "recon/maps/soft_maps.hpp"
#include "recon/models/layers.hpp"
#include "recon/numbers/matrix.hpp"
#include "recon/numbers/matrix_file.hpp"

namespace echofuse::recon {

class Alignment;

// Inputs and depth maps of the same records, and the rows of both to use. Inputs are scaled
// (features.hpp), or aligned (body/alignment.hpp) for models that want that.
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

// Options that are not given take the kind's own values (ModelKind::own).
struct FitOptions {
  std::optional<std::vector<std::size_t>> hidden = {};  // mlp: width of each hidden layer
  std::optional<std::size_t> basis = {};  // pca, factorised: components; nearest: records
  std::optional<std::size_t> epochs = {};
  std::optional<double> learning_rate = {}, weight_decay = {};
  // Epochs without a better validation loss before stopping.
  std::optional<std::size_t> patience = {};
  std::optional<std::size_t> batch = {};
  std::uint64_t seed = 1;
  bool quiet = false;
};

// One entry an epoch; empty for models that are fitted in one step. Root mean square errors: of an
// mlp in metres, of a pca-mlp in amounts of the components, of a factorised model of the place, in
// units of its spread.
struct TrainingLog {
  std::vector<double> loss, validation_loss;
  std::size_t best_epoch = 0;  // whose weights were kept, counted from 1; 0: none beat the mean
  bool interrupted = false;
};

// How a trained model is taken to the records of another room.
struct Tuning {
  // Weight of the mean squared distance from the weights that it came with, times the number of
  // records; INFINITY: the networks stay as they are.
  double pull = 1;
  // Of models that place a body: turn the bodies (body/turned.hpp). Of few records that does harm.
  bool turn = false;
  std::size_t steps = 200, batch = 64;  // at most so many records a step
  double learning_rate = 4e-3;          // at first; it falls to nothing
  std::uint64_t seed = 1;
  bool networks_stay() const { return std::isinf(pull); }
  // Of a mean residual over so many records, how much is believed.
  static double belief(std::size_t records) {
    return static_cast<double>(records) / static_cast<double>(records + 10);
  }
};

struct Cost {
  std::size_t multiply_adds = 0;  // for one map
  std::size_t parameters = 0;
  Cost& operator+=(const Cost& other) {
    multiply_adds += other.multiply_adds, parameters += other.parameters;
    return *this;
  }
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
  // The model as a chain from its inputs to metres, for other people's runtimes; none if it is no
  // such chain.
  virtual std::vector<AffineLayer> layers() const { return {}; }
  // Of one that places a body, for the same.
  virtual std::optional<BodyLayers> body_layers() const { return {}; }
  virtual void save(record::H5File& file) const = 0;  // below "model/"
  // Of a sealed file. Throws Error(failed) that names what does not fit to so many inputs and
  // outputs.
  virtual void load(const record::H5File& file, std::size_t inputs, std::size_t outputs) = 0;
};

// All that the rest of the program asks of a kind of model.
struct ModelKind {
  enum class Takes : std::uint8_t { nothing, inputs, aligned };  // aligned: body/alignment.hpp
  enum class Size : std::uint8_t { fixed, hidden, basis };       // what a name's numbers mean
  std::string name;
  std::unique_ptr<Model> (*make)();
  Takes takes;
  Size size;
  FitOptions own;  // what did best on validation records at the base condition
};
// To add one: a row there, its own file, and candidates() in estimator/crossvalidate.hpp if
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
