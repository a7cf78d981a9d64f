// SPDX-License-Identifier: MIT
// Interface of all models. It consists of functions to fit, predict, report the cost, and save.
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

// Inputs and depth maps of the same records. `rows` selects the records to use. Inputs are scaled
// (features.hpp), or aligned (method/alignment.hpp) if the model requires it.
struct Samples {
  const Matrix& inputs;
  const Matrix& maps;  // depth maps, m
  Rows rows;
  // Scene model learned from the training rows; null if not needed.
  const SceneModel* scene = nullptr;
  // Alignment of the inputs, and the recorded radar power and lags; null if the inputs are not
  // aligned.
  const Alignment* alignment = nullptr;
  const Matrix* radar = nullptr;
  const Matrix* array = nullptr;
};

class Model {
 public:
  virtual ~Model() = default;
  virtual TrainingLog fit(const Samples& train, const Samples& validation,
                          const FitOptions& options) = 0;
  // Returns a copy of the trained model that is adapted to a few records from another room. Returns
  // null if this kind of model cannot be fine-tuned.
  virtual std::unique_ptr<Model> tuned(const Samples&, const Tuning&) const { return {}; }
  // Replaces the background drawn behind the body. Returns false if the model does not draw bodies
  // on a background.
  virtual bool show_background(std::span<const float>) { return false; }
  // Returns one depth map per row, m. If `soft` is given, models that predict a body position also
  // fill it. Other models leave it empty, because their maps already contain the mean over all
  // positions.
  virtual Matrix predict(const Matrix& inputs, SoftMaps* soft = nullptr) const = 0;
  virtual Cost cost() const = 0;
  // Returns the options with which fit() creates a model of the same size.
  virtual FitOptions sizes() const { return {}; }
  // Writes the model to a file. In read mode, reads a model of the given shape and checks it
  // (numbers/tensor_file.hpp).
  struct Shape {
    std::size_t inputs, outputs;  // number of values per record; number of pixels per map
    record::MapGrid grid;
  };
  virtual void archive(Archive archive, const Shape& shape) = 0;
};

// Properties of a kind of model. The rest of the program uses only these properties.
struct ModelKind {
  enum class InputKind : std::uint8_t {
    nothing,
    inputs,
    aligned  // see method/alignment.hpp
  };
  // Meaning of the numbers in a model name, e.g. in "nearest-16".
  enum class Size : std::uint8_t { fixed, hidden, basis };
  std::string name;
  std::unique_ptr<Model> (*make)();
  InputKind takes;
  Size size;
  // Default options, chosen by the scores of validation records.
  FitOptions own;
  const char* scaling = "record";  // default scaling of the inputs (data/features.hpp)
};
// To add a kind of model, add a source file and a row to the list in model.cpp. To include it in
// `--model auto`, also add it to candidates() in train/crossvalidate.cpp.
const std::vector<ModelKind>& model_kinds();        // in order of increasing cost
const ModelKind& kind_of(const std::string& name);  // throws Error(usage) if the kind is unknown
std::vector<std::string> model_names();
std::string model_help();  // returns "empty, mean, ..., nearest[-N], paper (mlp-512-256)"

// Model of a given size. Examples of names:
//   "mlp-1024-512-256"  network with hidden layers of these widths
//   "factorised-8"      factorised model with 8 components
//   "nearest-16"        mean of 16 nearest neighbours
//   "paper"             network of Lai et al. (2024)
struct Candidate {
  std::string name, model;
  FitOptions fit;
};
// Returns the candidate of this name with default options for this number of training records
// (including duplicates). Options in `base` override the defaults. Throws Error(usage) if the name
// is invalid.
Candidate candidate_of(const std::string& name, const FitOptions& base, std::size_t records = 0);

// Properties of model kinds. The empty-room and mean-map models ignore their inputs. Models that
// predict a body position need aligned inputs, including the radar profile.
bool ignores_inputs(const std::string& name);
bool wants_alignment(const std::string& name);

}  // namespace echofuse::recon
